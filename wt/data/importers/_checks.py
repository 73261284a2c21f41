"""Checks of what was imported: units and signs that contradict each other, and delays.

A velocity that is not the slope of its position is refused, since physics leaves no choice. A
command that its joint does not follow is only doubted: a torque may well act against the motion.
Both name the column and the map's key that mends it; naming the column in the map (``signs:
{qvel/a: 1}``) says that it is right as it is.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.data.importers import _mapping
from wt.data.importers._mapping import Map
from wt.data.recording import coordinate
from wt.errors import DataError
from wt.types import Recording

DEGREE = np.pi / 180.0
_QUIETLY = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""Absurd numbers are refused or doubted; NumPy need not warn of them."""
_ALIKE = 0.8  # correlation from which two signals are the same quantity
_SLOWEST, _FASTEST = 0.25, 1.5e-4  # s, intervals of any controller's log
_TURNS = 4.0 * np.pi  # rad, more than a joint of a limb sweeps
_MAX_DELAY = 0.4  # s, longest delay looked for
_SHORT_DELAY = 0.06  # s, longest at which an answer's sign is checked


@_QUIETLY
def refuse_contradictions(recording: Recording, mapping: Map) -> None:
    """Refuse velocities of another sign or unit than the slope of their positions.

    Args:
        recording: what was imported, after the map.
        mapping: the map; what it says of a column itself is believed.

    Raises:
        DataError: naming the column and the map's key to set.
    """
    for joint in _joints(recording):
        position, velocity = f"qpos/{joint}", f"qvel/{joint}"
        r, factor = velocity_over_slope(recording, joint)
        if r < -_ALIKE and not _mapping.says(mapping, "signs", position, velocity):
            raise DataError(
                f"column '{velocity}' runs against the slope of '{position}'; set in the map "
                f"'signs: {{{velocity}: -1}}', or {position} if it is that which is reversed"
            )
        for column, expected in ((velocity, 1.0 / DEGREE), (position, DEGREE)):
            in_degrees = r > _ALIKE and 0.8 < factor / expected < 1.25
            if in_degrees and not _mapping.says(mapping, "units", position, velocity):
                raise DataError(
                    f"column '{column}' looks like degrees: {velocity} is {factor:.3g} times the "
                    f"slope of {position}; set in the map 'units: {{{column}: deg}}'"
                )


@_QUIETLY
def doubts(recording: Recording, mapping: Map) -> list[str]:
    """Doubts about columns that look wrong without being impossible, with the map's key to set.

    Args:
        recording: what was imported, after the map.
        mapping: the map; what it says of a column itself is believed.
    """
    lines = _doubts_of_time(recording)
    if not any(name.startswith("ctrl/") for name in recording.columns):
        lines.append(
            "no command was found, which is right for a machine without actuators alone; name "
            "the source of 'ctrl/<actuator>' in the map if there were any"
        )
    for joint in _joints(recording):
        position, velocity, command = (f"{kind}/{joint}" for kind in ("qpos", "qvel", "ctrl"))
        r, factor = velocity_over_slope(recording, joint)
        units_open = not _mapping.says(mapping, "units", position, velocity)
        if r > _ALIKE and not 0.5 < factor < 2.0 and units_open:
            lines.append(
                f"column '{velocity}' is {factor:.3g} times the slope of '{position}'; if it is "
                f"in another unit, set in the map 'units: {{{velocity}: {1.0 / factor:.3g}}}'"
            )
        sweep = np.nanmax(recording.columns[position]) - np.nanmin(recording.columns[position])
        if sweep > _TURNS and velocity not in recording.columns and units_open:
            lines.append(
                f"column '{position}' sweeps {sweep:.3g} rad; if these are degrees, set in the "
                f"map 'units: {{{position}: deg}}' (or 'units: deg' for all)"
            )
        if _lag(recording, command, f"force/{joint}") is None:
            # no torque command: the position should follow it
            lines += _doubts_of_follower(recording, mapping, command, position)
        lines += _doubts_of_follower(recording, mapping, command, f"force/{joint}")
    return lines


def _doubts_of_time(recording: Recording) -> list[str]:
    """A doubt about a log that is slower than any controller's, in seconds."""
    interval = float(np.median(np.diff(recording.t)))
    for unit, factor in {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}.items():
        if interval > _SLOWEST and _FASTEST <= interval * factor <= _SLOWEST:
            return [
                f"column 't' has a sample every {interval:.4g} s and lasts {recording.seconds:.4g} "
                f"s; time looks like {unit}, which would be {1.0 / (interval * factor):.4g} Hz: "
                f"set in the map of a table 'time: {{column: …, scale: {factor:g}}}', or let "
                "'wt check RECORDING --fix --out DIR' write it in seconds"
            ]
    return []


@_QUIETLY
def delays(recording: Recording) -> dict[str, float]:
    """Delay from commands to what answers them, by actuator [s].

    The answer is the measured force where there is one that follows the command, and then the
    delay is the lag at which both correlate best. Otherwise it is the motion of the joint of the
    same name, with the lag at which the *changes* of both correlate best: of a servo that is its
    whole response, not its dead time alone. Nothing is found where little correlates.

    Args:
        recording: what was imported.
    """
    by_actuator = {}
    for column in recording.columns:
        name = column.removeprefix("ctrl/")
        if name == column:
            continue
        for answer in (f"force/{name}", f"qpos/{name}"):
            delay = _lag(recording, column, answer)
            if delay is not None:
                by_actuator[name] = delay
                break
    return by_actuator


def _joints(recording: Recording) -> list[str]:
    """Joints with a position that moves."""
    names = []
    for column, values in recording.columns.items():
        joint = column.removeprefix("qpos/")
        if joint != column and coordinate(joint) is None and np.nanstd(values) > 1e-9:
            names.append(joint)
    return names


def velocity_over_slope(recording: Recording, joint: str) -> tuple[float, float]:
    """Correlation of the velocity with the slope of the position, and ratio of their spreads."""
    position, velocity = (recording.columns.get(f"{kind}/{joint}") for kind in ("qpos", "qvel"))
    if position is None or velocity is None:
        return 0.0, 1.0
    # central difference, on the samples between
    slope = (position[2:] - position[:-2]) / (recording.t[2:] - recording.t[:-2])
    both = np.isfinite(slope) & np.isfinite(velocity[1:-1])
    slope, velocity = slope[both], velocity[1:-1][both]
    if len(slope) < 10 or slope.std() < 1e-9 or velocity.std() < 1e-9:
        return 0.0, 1.0
    return float(np.corrcoef(slope, velocity)[0, 1]), float(velocity.std() / slope.std())


def _doubts_of_follower(recording: Recording, mapping: Map, command: str, answer: str) -> list[str]:
    """Doubts about a quantity that equals its command after a while, if it is such a one."""
    pair = _on_a_clock(recording, command, answer)
    if pair is None:
        return []
    step, (u, x) = pair
    # at short lags only: at long ones a slow oscillation agrees with itself reversed
    r = _lagged_correlation(u, x, max(int(_SHORT_DELAY / step), 1))
    k = int(np.argmax(np.abs(r)))
    slope = r[k] * np.nanstd(x) / np.nanstd(u)
    reversed_ = r[k] < -_ALIKE and r.max() < 0.0 and -1.5 < slope < -0.5
    if reversed_ and not _mapping.says(mapping, "signs", command, answer):
        return [
            f"column '{answer}' runs against '{command}'; if one of them is reversed, set in the "
            f"map 'signs: {{{command}: -1}}' or 'signs: {{{answer}: -1}}'"
        ]
    for column, expected in ((command, DEGREE), (answer, 1.0 / DEGREE)):
        degrees = r[k] > _ALIKE and 0.8 < slope / expected < 1.25
        if degrees and not _mapping.says(mapping, "units", command, answer):
            return [
                f"column '{column}' may be in degrees: {answer} follows {command} times "
                f"{slope:.3g}; if so, set in the map 'units: {{{column}: deg}}'"
            ]
    return []


def _lag(recording: Recording, command: str, answer: str) -> float | None:
    pair = _on_a_clock(recording, command, answer)
    if pair is None:
        return None
    step, (u, x) = pair
    of_force = answer.startswith("force/")
    if not of_force:
        u, x = np.diff(u), np.diff(x)
    r = _lagged_correlation(u, x, int(_MAX_DELAY / step))
    k = int(np.argmax(r))
    if r[k] < (_ALIKE if of_force else 0.5 * _ALIKE) or k == len(r) - 1:
        return None
    if k == 0:
        return 0.0 if of_force else None
    # the peak of the parabola through the three highest points
    bend = r[k - 1] - 2.0 * r[k] + r[k + 1]
    return float((k + 0.5 * (r[k - 1] - r[k + 1]) / bend) * step)


def _on_a_clock(
    recording: Recording, *names: str
) -> tuple[float, list[Float[np.ndarray, " time"]]] | None:
    """Median step [s] and two columns at even times; NaN stays. None if they cannot be compared."""
    step = float(np.median(np.diff(recording.t)))
    clock = np.arange(recording.t[0], recording.t[-1], step)
    columns = [recording.columns.get(name) for name in names]
    resampled = [np.interp(clock, recording.t, x) for x in columns if x is not None]
    enough = 3 * int(_MAX_DELAY / step)
    if len(resampled) < len(names) or enough < 3:
        return None
    moving = [np.isfinite(x).sum() > enough and np.nanstd(np.diff(x)) > 1e-6 for x in resampled]
    return (step, resampled) if all(moving) else None


def _lagged_correlation(
    u: Float[np.ndarray, " time"], x: Float[np.ndarray, " time"], longest: int
) -> Float[np.ndarray, " lag"]:
    """Correlation of u with x delayed by 0…longest samples, over the pairs without NaN."""
    r = np.zeros(longest + 1)
    for k in range(longest + 1):
        early, late = u[: len(u) - k], x[k:]
        both = np.isfinite(early) & np.isfinite(late)
        early, late = early[both], late[both]
        if len(early) > 10 and early.std() > 0.0 and late.std() > 0.0:
            r[k] = np.corrcoef(early, late)[0, 1]
    return r
