"""Units and signs of columns, by the model's ranges and by what contradicts itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float

from wt.data.importers import _checks
from wt.data.recording import DEGREE
from wt.types import Recording

_BEYOND = 0.5  # rad past a limit that a sensor's offset may explain
_TURNS = 4.0 * np.pi  # rad, more than a joint of a limb sweeps
_TURN = 2.0 * np.pi
_ALIKE = 0.8


@dataclass
class Units:
    """Entries of a map.

    Attributes:
        units: column → unit.
        signs: column → -1.
        notes: column → why.
        doubts: what the data leave open.
    """

    units: dict[str, str] = field(default_factory=dict)
    signs: dict[str, int] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)


def units(recording: Recording, named: dict[str, str], model: mujoco.MjModel | None) -> Units:
    """Units and signs.

    Args:
        recording: under the model's names, as its source has it.
        named: column → the unit that its name in the source says.
        model: the robot, if there is one.
    """
    found = Units()
    for column, unit in named.items():
        if unit not in ("rad", "SI") and column in recording.columns:
            found.units[column] = unit
            found.notes[column] = "its name says so"
    limits = _limits(model) if model is not None else {}
    for column, values in recording.columns.items():
        kind, _, joint = column.partition("/")
        if kind in ("qpos", "ctrl") and column not in named and np.isfinite(values).any():
            _by_range(found, column, values, limits.get(column), model is not None)
    for column in recording.columns:
        kind, _, joint = column.partition("/")
        if kind == "qpos":
            _by_slope(found, recording, joint)
            _by_answer(found, recording, joint)
    return found


def _by_range(
    found: Units,
    column: str,
    values: Float[np.ndarray, " time"],
    limit: Float[np.ndarray, "low_high=2"] | None,
    modelled: bool,
) -> None:
    """Degrees, where radians would leave the joint's range, or turn it round and round."""
    low, high = np.nanquantile(values, [0.01, 0.99])
    runs = f"it runs from {low:.4g} to {high:.4g}"
    if limit is not None:
        inside = low >= limit[0] - _BEYOND and high <= limit[1] + _BEYOND
        fits = low * DEGREE >= limit[0] - _BEYOND and high * DEGREE <= limit[1] + _BEYOND
        if not inside and fits and max(abs(low), abs(high)) > _TURN:
            found.units[column] = "deg"
            found.notes[column] = f"{runs}, the model allows {limit[0]:.3g} to {limit[1]:.3g} rad"
        elif not inside:
            found.doubts.append(
                f"{column}: {runs} and the model allows {limit[0]:.4g} to {limit[1]:.4g}: another "
                "unit, another zero ('offsets'), or percent of a range?"
            )
        return
    if not modelled and column.startswith("qpos/") and high - low > _TURNS:
        found.units[column] = "deg"
        found.notes[column] = f"{runs}: as radians it would turn round and round"
        found.doubts.append(f"{column} is taken for degrees, since {runs}; percent, or a wheel?")


def _by_slope(found: Units, recording: Recording, joint: str) -> None:
    """Make a velocity the slope of its position, in unit and sign; the position is trusted."""
    position, velocity = f"qpos/{joint}", f"qvel/{joint}"
    r, factor = _checks.velocity_over_slope(recording, joint)
    if abs(r) < _ALIKE:
        if velocity in recording.columns and abs(r) > 0.0:
            found.doubts.append(
                f"{velocity} is not the slope of {position} (correlation {r:.2f}): another joint's?"
            )
        return
    if r < 0.0:
        found.signs[velocity] = -1
        found.doubts.append(f"{velocity} runs against {position}: it may be {position} that is")
    in_degrees = found.units.get(position) == "deg"
    if 0.8 < factor < 1.25:
        if in_degrees and velocity not in found.units:
            found.units[velocity] = "deg"
            found.notes[velocity] = f"it is the slope of {position} as it stands"
    elif 0.8 < factor * DEGREE < 1.25 and velocity not in found.units:
        found.units[velocity] = "deg"
        found.notes[velocity] = f"{factor:.3g} times the slope of {position}"
    elif 0.8 < factor / DEGREE < 1.25 and position not in found.units:
        found.units[position] = "deg"
        found.notes[position] = f"{velocity} is {factor:.3g} times its slope"
    elif not in_degrees and velocity not in found.units:
        found.doubts.append(
            f"{velocity} is {factor:.3g} times the slope of {position}: which unit?"
        )


def _by_answer(found: Units, recording: Recording, joint: str) -> None:
    """Put a command that runs as far as its position into the position's unit."""
    position, command = f"qpos/{joint}", f"ctrl/{joint}"
    if found.units.get(position) != "deg" or command not in recording.columns:
        return
    measured, sent = (float(np.nanstd(recording.columns[c])) for c in (position, command))
    if command not in found.units and 0.5 < sent / (measured + 1e-30) < 2.0:
        found.units[command] = "deg"
        found.notes[command] = f"it runs as far as {position}"


def _limits(model: mujoco.MjModel) -> dict[str, Float[np.ndarray, "low_high=2"]]:
    """Column → range [rad] of hinges, and of the commands that are positions of one."""
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    limits = {
        f"qpos/{model.joint(i).name}": model.jnt_range[i]
        for i in range(model.njnt)
        if model.jnt_type[i] == hinge and model.jnt_limited[i]
    }
    for i in range(model.nu):
        joint = model.actuator_trnid[i, 0]
        # a position servo's force falls with the joint's position: bias -kp·q
        servo = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT and (
            model.actuator_biasprm[i, 1] < 0
        )
        if servo and model.jnt_type[joint] == hinge:
            limited = bool(model.actuator_ctrllimited[i])
            allowed = model.actuator_ctrlrange[i] if limited else model.jnt_range[joint]
            if limited or model.jnt_limited[joint]:
                limits[f"ctrl/{model.actuator(i).name}"] = allowed
    return limits
