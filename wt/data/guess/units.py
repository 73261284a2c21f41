"""Units and signs of columns, by the model's ranges and by what contradicts itself."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float

from wt.data.importers import _checks
from wt.data.recording import DEGREE, coordinate
from wt.types import Recording

_BEYOND = 0.5  # rad past a limit that a sensor's offset may explain
_TURNS = 4.0 * np.pi  # rad, more than a joint of a limb sweeps
_TURN = 2.0 * np.pi
_CORRELATED = 0.8


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
    slides = _slides(model) if model is not None else set()
    for column, values in recording.columns.items():
        kind, _, _ = column.partition("/")
        if kind not in ("qpos", "ctrl") or column in named or not np.isfinite(values).any():
            continue
        if column in limits:
            _by_range(found, column, values, limits[column])
        elif kind == "qpos" and column not in slides and coordinate(column) is None:
            _by_turns(found, column, values)
    _alike(found, recording, limits, slides)
    for column in recording.columns:
        kind, _, joint = column.partition("/")
        if kind == "qpos":
            _by_slope(found, recording, joint)
            command, of_position = _command_of(joint, model)
            _by_answer(found, recording, column, command, of_position)
    return found


def _by_range(
    found: Units,
    column: str,
    values: Float[np.ndarray, " time"],
    limit: Float[np.ndarray, "low_high=2"],
) -> None:
    """Degrees, where radians would leave the joint's range."""
    low, high = np.nanquantile(values, [0.01, 0.99])
    runs = f"it runs from {low:.4g} to {high:.4g}"
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


def _by_turns(found: Units, column: str, values: Float[np.ndarray, " time"]) -> None:
    """Degrees, where nothing limits the joint and radians would turn it round and round."""
    low, high = np.nanquantile(values, [0.01, 0.99])
    runs = f"it runs from {low:.4g} to {high:.4g}"
    if high - low > _TURNS:
        found.units[column] = "deg"
        found.notes[column] = f"{runs}: as radians it would turn round and round"
        found.doubts.append(f"{column} is taken for degrees, since {runs}; percent, or a wheel?")
    elif high - low > _TURN:
        found.doubts.append(f"{column}: {runs}; radians, or degrees?")


def _alike(
    found: Units,
    recording: Recording,
    limits: Mapping[str, Float[np.ndarray, "low_high=2"]],
    slides: Collection[str],
) -> None:
    """Degrees for all angles where one must be: a log has one unit, as a rule."""
    sure = [column for column, unit in found.units.items() if unit == "deg"]
    kinds = {column.partition("/")[0] for column in sure}
    for column, values in recording.columns.items():
        kind = column.partition("/")[0]
        angle = kind == "qpos" and column not in slides and coordinate(column) is None
        angle |= kind == "ctrl" and kind in kinds and column in limits
        if not (angle and "qpos" in kinds) or column in found.units:
            continue
        if not np.isfinite(values).any():
            continue
        low, high = DEGREE * np.nanquantile(values, [0.01, 0.99])
        limit = limits.get(column, np.array([-np.inf, np.inf]))
        if low >= limit[0] - _BEYOND and high <= limit[1] + _BEYOND:
            found.units[column] = "deg"
            found.notes[column] = f"as {sure[0]}: see that it is not in radians"


def _by_slope(found: Units, recording: Recording, joint: str) -> None:
    """Make a velocity the slope of its position, in unit and sign; the position is trusted."""
    position, velocity = f"qpos/{joint}", f"qvel/{joint}"
    r, factor = _checks.velocity_over_slope(recording, joint)
    if abs(r) < _CORRELATED:
        if velocity in recording.columns and found.units.get(position) == "deg":
            found.units.setdefault(velocity, "deg")
            found.notes.setdefault(velocity, f"as {position}: see that it is not in radians")
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


def _by_answer(
    found: Units, recording: Recording, position: str, command: str, of_position: bool
) -> None:
    """Put a command that runs about as far as its position into the position's unit."""
    if found.units.get(position) != "deg" or command not in recording.columns:
        return
    measured, sent = (float(np.nanstd(recording.columns[c])) for c in (position, command))
    # a servo may stay far behind its command; in radians it would be 57 times as far
    ratio, most = sent / (measured + 1e-30), 10.0 if of_position else 2.0
    if command not in found.units and 1.0 / most < ratio < most:
        found.units[command] = "deg"
        found.notes[command] = f"it runs {ratio:.2g} times as far as {position}"


def _command_of(joint: str, model: mujoco.MjModel | None) -> tuple[str, bool]:
    """The column of the commands that move a joint, and whether they are positions."""
    if model is not None:
        for i in range(model.nu):
            moves = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
            if moves and model.joint(model.actuator_trnid[i, 0]).name == joint:
                return f"ctrl/{model.actuator(i).name}", bool(model.actuator_biasprm[i, 1] < 0)
    return f"ctrl/{joint}", False


def _slides(model: mujoco.MjModel) -> set[str]:
    """Columns of the positions of slides."""
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    return {f"qpos/{model.joint(i).name}" for i in range(model.njnt) if model.jnt_type[i] == slide}


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
