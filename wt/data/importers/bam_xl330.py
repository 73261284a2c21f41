"""Logs of the servo pendulum bench: one JSON file with its set-up and a list of entries.

The one joint and its servo become ``hinge``, angle 0 hanging down, as in
:func:`wt.worlds.rigs.servo_bench_spec`. The command is ``goal_position`` [rad]. **While the torque
is off the command is NaN**: the servo exerts nothing then, whatever its goal register holds, and
no position command would say so. ``load`` is a duty cycle and no force, so it becomes no column;
the log's gain, supply and temperature go into the metadata under ``kp``, ``supply_v`` (lowest,
median, highest [V]), ``temperature_c`` and ``duty`` (largest magnitude).

No keys of a map beyond those that every format has.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from wt.data.importers.base import Map, register
from wt.errors import DataError
from wt.types import Recording

JOINT = "hinge"
_DUTY_FULL = 885.0  # the servo's PWM register at duty 1
_SET_UP = ("mass", "length", "kp", "vin", "motor", "trajectory")
_FIELDS = ("timestamp", "position", "speed", "goal_position", "torque_enable", "load",
           "input_volts", "temp")  # fmt: skip


@register
class BamXL330:
    """Reads one log."""

    name: ClassVar[str] = "bam_xl330"
    about: ClassVar[str] = "a .json log of the servo bench (kp, vin, entries)"
    keys: ClassVar[frozenset[str]] = frozenset()
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a log."""
        if path.suffix != ".json" or not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.read(4096)
        return b'"kp"' in head and b'"entries"' in head

    def read(self, path: Path, mapping: Map) -> Recording:
        """The log as a recording; see the module for what is what.

        Raises:
            DataError: it is no whole JSON, or an entry lacks a field.
        """
        try:
            log: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            set_up = {key: log[key] for key in _SET_UP}
            raw = {
                field: np.array([entry[field] for entry in log["entries"]], dtype=np.float64)
                for field in _FIELDS
            }
        except KeyError as error:
            raise DataError(f"'{path}' is a servo log without {error}") from error
        except (ValueError, TypeError, OSError) as error:
            raise DataError(
                f"'{path}' is not a whole JSON log (cut off or edited?): {error}"
            ) from error
        if not len(raw["timestamp"]):
            raise DataError(f"'{path}' is a servo log without entries; record it again")
        on = raw["torque_enable"] > 0.5
        columns = {
            f"ctrl/{JOINT}": np.where(on, raw["goal_position"], np.nan),
            f"qpos/{JOINT}": raw["position"],
            f"qvel/{JOINT}": raw["speed"],
        }
        # 16-bit two's complement of the PWM register
        duty = ((raw["load"] + 32768.0) % 65536.0 - 32768.0) / _DUTY_FULL
        meta = {"robot": "XL330 servo bench", "source": path.name, "format": self.name}
        meta |= set_up | {
            "supply_v": [float(f(raw["input_volts"])) for f in (np.min, np.median, np.max)],
            "temperature_c": [float(raw["temp"].min()), float(raw["temp"].max())],
            "duty": float(np.abs(duty).max()),
            "notes": f"torque on for {100.0 * on.mean():.0f} % of the samples; NaN where off",
        }
        return Recording(raw["timestamp"], columns, meta)
