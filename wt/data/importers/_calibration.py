"""LeRobot's calibration of a robot's servos: normalised positions and degrees as radians.

A file of ``lerobot-calibrate`` says of each motor ``range_min`` and ``range_max`` in counts of the
encoder. As ``MotorsBus._normalize`` has it (github.com/huggingface/lerobot, ``motors_bus.py``), a
position is then logged as −100…100 of that range, as 0…100 of it (grippers), or in degrees from its
middle. Radians are counted from the middle too, a gripper's from ``range_min``. The direction is
the logged one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from wt.errors import DataError

COUNT = 2.0 * np.pi / 4095.0
"""A count of the encoders [rad]: LeRobot divides a turn by the resolution of 4096 less one."""
_FULL = 100.5  # of 100: what rounding may leave

Column = Float64[np.ndarray, " row"]


@dataclass(frozen=True)
class Calibration:
    """A robot's servos.

    Attributes:
        path: of the file.
        span: of each motor, ``range_max`` − ``range_min`` [rad].
    """

    path: Path
    span: Mapping[str, float]

    def radians(self, columns: Mapping[str, Column], unit: object) -> tuple[dict[str, Column], str]:
        """Positions and their commands in radians.

        Args:
            columns: by recording column; those of motors without a calibration stay.
            unit: percent or degrees, of joints that are no gripper; None to tell by the values.

        Returns:
            The columns, and what was assumed of their unit.
        """
        places = {f"{kind}/{motor}" for kind in ("qpos", "ctrl") for motor in self.span}
        mine = {name: values for name, values in columns.items() if name in places}
        arm = [x for n, x in mine.items() if not _is_gripper(n)]
        told = unit
        if unit is None:
            within = all(np.nanmax(np.abs(x), initial=0.0) <= _FULL for x in arm)
            told = "percent" if within else "degrees"
        converted = dict(columns)
        for name, values in mine.items():
            span = self.span[name.partition("/")[2]]
            if _is_gripper(name):
                converted[name] = values / 100.0 * span
            elif told == "percent":
                converted[name] = values / 200.0 * span
            else:
                converted[name] = np.deg2rad(values)
        said = (
            f"positions are taken for {told} and, by the calibration {self.path.name}, are radians "
            "from the middle of the range ('offsets' moves the zero)"
        )
        if unit is None:
            said += "; if they are not, set in the map 'unit: percent' or 'unit: degrees'"
        return converted, said


def read(path: Path) -> Calibration:
    """A calibration.

    Raises:
        DataError: it is none of LeRobot's.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        span = {
            str(motor): COUNT * (float(entry["range_max"]) - float(entry["range_min"]))
            for motor, entry in content.items()
        }
        if not span or not all(0.0 < s < 20.0 for s in span.values()):
            raise ValueError("a range is empty, or no range of counts")
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise DataError(
            f"calibration '{path}' is none of lerobot-calibrate ('<motor>: {{range_min: …, "
            f"range_max: …}}' each): {error}"
        ) from error
    return Calibration(path, span)


def of_dataset(folder: Path, wanted: object) -> Calibration | None:
    """The calibration that the map names, else the dataset's, where LeRobot keeps it.

    Args:
        folder: of the dataset.
        wanted: a file, from the dataset's folder or from here; False for none; None to look.

    Raises:
        DataError: it is missing, or there are several.
    """
    if wanted is False:
        return None
    if wanted is not None:
        named = [p for p in (folder / str(wanted), Path(str(wanted))) if p.is_file()]
        if not named:
            raise DataError(f"map calibration: there is no file {str(wanted)!r}")
        return read(named[0])
    found = sorted((folder / "calibration" / "robots").glob("*/*.json"))
    if len(found) > 1:
        names = ", ".join(str(p.relative_to(folder)) for p in found[:4])
        raise DataError(
            f"'{folder}' has several calibrations; set in the map 'calibration: …': {names}"
        )
    return read(found[0]) if found else None


def _is_gripper(column: str) -> bool:
    return "gripper" in column
