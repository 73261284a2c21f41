"""SO-101 motion folders as the sage recordings have them: control.csv and state_motor.csv.

Joint names become those of the published MJCF, microseconds seconds, and the jaw's 0…1 radians
of its published range. Velocities come either in rad/s or as the servo's register (encoder
counts per second, whole numbers): both become rad/s. The column "torques" is left out: it is the
magnitude of a current, without a sign, so neither an actuator's force nor a sensor of an MJCF.

Map (all optional)::

    joints: {Rotation: pan}     # other names than the published MJCF's
    jaw_range: [-0.1745, 1.745] # rad at 0 and at 1
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float64

from wt.data.importers import _csv
from wt.data.importers.base import Map, register
from wt.errors import DataError, suggest
from wt.types import Recording

JOINTS = {
    "Rotation": "shoulder_pan",
    "Pitch": "shoulder_lift",
    "Elbow": "elbow_flex",
    "Wrist_Pitch": "wrist_flex",
    "Wrist_Roll": "wrist_roll",
    "Jaw": "gripper",
}
"""Names in joint_list.txt, in the columns' order → names in the published MJCF."""
JAW_RANGE = (-0.17453298, 1.74532920)
COUNT = 2.0 * np.pi / 4096.0
"""One step of the servo's encoder [rad]."""

_CONTROL, _STATE, _LIST = "control.csv", "state_motor.csv", "joint_list.txt"


@register
class SageSO101:
    """Reads one motion folder."""

    name: ClassVar[str] = "sage_so101"
    about: ClassVar[str] = f"a folder with {_CONTROL} and {_STATE}"
    keys: ClassVar[frozenset[str]] = frozenset({"joints", "jaw_range"})
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a folder."""
        return (path / _CONTROL).is_file() and (path / _STATE).is_file()

    def read(self, path: Path, mapping: Map) -> Recording:
        """The motion as a recording; see the module for what is converted.

        Raises:
            DataError: a file is broken, the two disagree, or the map does not fit.
        """
        names = _joint_names(path, dict(mapping.get("joints", {})))
        low, high = mapping.get("jaw_range", JAW_RANGE)
        control = _table(path / _CONTROL, ["positions"], len(names))
        state = _table(path / _STATE, ["positions", "velocities", "torques"], len(names))
        t, t_state = control["timestamp"][:, 0], state["timestamp"][:, 0]
        if len(t) != len(t_state) or np.abs(t - t_state).max() > 1e3:
            raise DataError(
                f"'{path}': {_CONTROL} has {len(t)} rows and {_STATE} {len(t_state)}, and their "
                "time stamps must agree within 1 ms; cut both to the same samples"
            )
        velocity = state["velocities"]
        if _is_register(velocity, state["torques"]):
            velocity = velocity * COUNT
        jaw = names[list(JOINTS).index("Jaw")]
        columns: dict[str, Float64[np.ndarray, " row"]] = {}
        for i, name in enumerate(names):
            command, position, speed = control["positions"][:, i], state["positions"][:, i], 1.0
            if name == jaw:
                speed = (high - low) / _swept(position, high - low)
                command, position = (low + (high - low) * x for x in (command, position))
            columns[f"ctrl/{name}"] = command
            columns[f"qpos/{name}"] = position
            columns[f"qvel/{name}"] = velocity[:, i] * speed
        meta = {"robot": "SO-101", "source": path.name, "format": self.name}
        meta |= {"notes": "currents left out: their magnitude only was recorded"}
        return Recording(t * 1e-6, columns, meta)


def _joint_names(path: Path, renamed: dict[str, str]) -> list[str]:
    for name in renamed:
        if name not in JOINTS:
            raise DataError(f"map joint {name!r} is not known: {suggest(name, JOINTS)}")
    if (path / _LIST).is_file():  # repeats come without one
        listed = (path / _LIST).read_text(encoding="utf-8").split()
        if listed != list(JOINTS):
            raise DataError(
                f"'{path / _LIST}' lists {', '.join(listed)}; this format has {', '.join(JOINTS)}"
            )
    return list((JOINTS | renamed).values())


def _table(path: Path, lists: list[str], width: int) -> dict[str, Float64[np.ndarray, "row _"]]:
    """The time stamps [µs] as one column, and the bracketed lists of a file."""
    try:
        table = _csv.read(path)
        columns = {"timestamp": _csv.numbers(table["timestamp"])[:, None]}
        for name in lists:
            rows = [row.strip("[] ").split(",") for row in table[name].to_pylist()]
            columns[name] = np.array(rows, dtype=np.float64).reshape(len(rows), width)
    except KeyError as error:
        raise DataError(f"'{path}' has no column {error}; it needs timestamp, {lists}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"'{path}' is not a table of [{width} numbers] per row (cut off or edited?): {error}"
        ) from error
    return columns


def _is_register(
    velocity: Float64[np.ndarray, "row joint"], torque: Float64[np.ndarray, "row joint"]
) -> bool:
    """True for the servo's whole-numbered registers, False for SI values."""
    return all((x == np.round(x)).all() for x in (velocity, torque))


def _swept(jaw: Float64[np.ndarray, " row"], otherwise: float) -> float:
    """Servo angle between jaw 0 and 1 [rad]: its smallest step is one encoder count."""
    steps = np.diff(np.unique(jaw))
    return float(COUNT / steps.min()) if len(steps) else otherwise
