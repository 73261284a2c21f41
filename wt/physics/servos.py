"""What the firmware of a position servo remembers: where its goal has got to, and its integral.

Both follow from what was sent and measured since a recording began, so that a replay that begins in
the middle of one begins with them. A goal is taken to begin at the first command; an integral with
what the forces on the joint say, see :func:`integral`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.motion import Motion
from wt.physics.parts import settle
from wt.physics.replay import Stretch
from wt.physics.scene import Drive, Scene
from wt.types import Location

_RIDGE = 1e-4
"""Of the squares of what may act beside an integral: one that never acts is as good as none."""
_LOOSE_S = 0.3
"""Begin and end of a segment, where a smooth curve says little of forces [s]."""
_STOPPED = 0.1
"""Share of a joint's usual speed below which dry friction has no clear sign."""
_FASTEST = 0.999
"""Quantile of a joint's speeds that is its fastest: above are blows and noise."""
_EXACT = 1e-6
"""Share by which the gain of a servo's command and that of its position may differ."""


def servos(scene: Scene) -> list[Location]:
    """Drives that follow a position as it is sent: what MuJoCo's ``pid`` is without its states."""
    none = mujoco.mjtDyn.mjDYN_NONE
    return [
        Location("actuator", d.name)
        for d in scene.drives
        if scene.model.actuator_dyntype[d.index] == none
        and scene.model.actuator_gaintype[d.index] == mujoco.mjtGain.mjGAIN_FIXED
        and scene.model.actuator_ctrlnum[d.index] == 1
        and d.servo
        and d.gear != 0.0
        and abs(d.gain + d.bias[1]) <= _EXACT * d.gain
    ]


def fastest(motion: Motion, drive: Drive) -> float:
    """Fastest that a drive's joint moves, but for blows and noise [rad/s]."""
    return float(np.quantile(np.abs(motion.v[:, drive.dof]), _FASTEST))


def as_pid(spec: mujoco.MjSpec, name: str) -> mujoco.MjsActuator:
    """Make a servo the ``pid`` that it is without integral action and limited speed, in place."""
    settle(spec)
    actuator = spec.actuator(name)
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_PID:
        actuator.dyntype, actuator.gaintype = mujoco.mjtDyn.mjDYN_PID, mujoco.mjtGain.mjGAIN_PID
        # kp is −biasprm[1]; what a user's class says of filters is about none of these
        actuator.gainprm, actuator.dynprm = np.zeros(10), np.zeros(10)
        actuator.ctrlspec = int(mujoco.mjtCtrlInput.mjINPUT_POS)
        actuator.actearly, actuator.actdim = False, -1
        actuator.actlimited = mujoco.mjtLimited.mjLIMITED_FALSE
    return actuator


# -- goals that move with limited speed


class Goal(NamedTuple):
    """Where a goal is.

    Attributes:
        at: in the command's unit.
        rate: how fast it moves, in that per second.
    """

    at: float
    rate: float = 0.0


def slewed(
    u: Float[np.ndarray, " interval"], h: float, speed: float, start: float
) -> Float[np.ndarray, " interval"]:
    """A goal at the end of each interval of a held command, (n,), as MuJoCo's ``slewmax`` has it.

    Args:
        u: commands, (n,).
        h: length of an interval [s].
        speed: most that the goal moves by, in the command's unit per second.
        start: where it begins.
    """
    goals: np.ndarray = _compiled(_slewed)(np.ascontiguousarray(u, dtype=float), speed * h, start)
    return goals


def _slewed(u: np.ndarray, most: float, goal: float) -> np.ndarray:
    goals = np.empty(len(u))
    for k in range(len(u)):
        goal += min(max(u[k] - goal, -most), most)
        goals[k] = goal
    return goals


def profiled(
    u: Float[np.ndarray, " interval"], h: float, speed: float, acceleration: float, start: Goal
) -> Float[np.ndarray, "interval 2"]:
    """A goal that stops at the command, and its rate, at the end of each interval, (n, 2).

    It is as fast as it can be stopped from by then, in steps: over n of them it goes
    acceleration · h² · n (n + 1) / 2.

    Args:
        u: commands, (n,).
        h: length of an interval [s].
        speed: most that the goal moves by, in the command's unit per second.
        acceleration: most that this changes by, in that per second.
        start: where it begins.
    """
    sent = np.ascontiguousarray(u, dtype=float)
    path: np.ndarray = _compiled(_profiled)(sent, h, speed, acceleration, start.at, start.rate)
    return path


def _profiled(
    u: np.ndarray, h: float, speed: float, acceleration: float, at: float, rate: float
) -> np.ndarray:
    path, most = np.empty((len(u), 2)), acceleration * h
    for k in range(len(u)):
        left = u[k] - at
        fast = np.sqrt(0.25 * most * most + 2.0 * acceleration * abs(left)) - 0.5 * most
        fast = min(fast, speed, abs(left) / h)
        rate += min(max((fast if left > 0.0 else -fast) - rate, -most), most)
        at += rate * h
        path[k, 0], path[k, 1] = at, rate
    return path


@functools.cache
def _compiled(function: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """A function in machine code."""
    from wt.physics.compiled import fast  # takes a second to import

    made: Callable[..., np.ndarray] = fast(function)
    return made


class Sent(NamedTuple):
    """What was sent to one actuator before a stretch, in its segment of the recording.

    Attributes:
        u: commands at even times, each held until the next, (n,).
        dt: time between them [s].
        last: how long the last was held [s].
    """

    u: Float[np.ndarray, " sample"]
    dt: float
    last: float


def sent(stretch: Stretch, drive: Drive) -> Sent:
    """Commands before a stretch, at least one, as far as the drive takes them."""
    motion, segment = stretch.motion, stretch.segment
    if motion is None or segment is None:
        return Sent(np.clip(stretch.command[:1, drive.index], *drive.commands), 1.0, 0.0)
    times, u = motion.t[segment.rows], motion.command[segment.rows, drive.index]
    count = max(1, int(np.searchsorted(times, stretch.t[0] - 1e-9)))
    last = max(float(stretch.t[0] - times[count - 1]), 0.0)
    return Sent(np.clip(u[:count], *drive.commands), segment.dt, last)


# -- integral action


class _Integrals(NamedTuple):
    """Integral of a drive's position error along a motion, and what its forces say of its begin.

    Attributes:
        error: since each segment's begin, (T,) [rad·s].
        of_error: constant part of that in each segment [rad·s].
        of_force: constant part of what the drive lacks in each segment [N·m].
        gain: that the forces say by least squares [N·m/(rad·s)].
    """

    error: Float[np.ndarray, " sample"]
    of_error: Float[np.ndarray, " segment"]
    of_force: Float[np.ndarray, " segment"]
    gain: float


_known: WeakKeyDictionary[Motion, dict[str, _Integrals]] = WeakKeyDictionary()


def _integrals(motion: Motion, actuator: str) -> _Integrals:
    """Worked out once, as long as the motion lives."""
    of_motion = _known.setdefault(motion, {})
    if actuator not in of_motion:
        of_motion[actuator] = _integrated(motion, actuator)
    return of_motion[actuator]


def _integrated(motion: Motion, actuator: str) -> _Integrals:
    drive = motion.scene.drive(actuator)
    error = np.zeros(len(motion))
    target = np.clip(motion.command[:, drive.index], *drive.commands) / drive.gear
    q, v = motion.q[:, drive.dof], motion.v[:, drive.dof]
    constant, clear = np.zeros((len(motion), len(motion.segments))), np.ones(len(motion))
    for i, s in enumerate(motion.segments):
        mean = 0.5 * (q[s.rows][1:] + q[s.rows][:-1])
        error[s.rows][1:] = np.cumsum(target[s.rows][:-1] - mean) * s.dt
        constant[s.rows, i] = 1.0
        loose = min(round(_LOOSE_S / s.dt), (s.rows.stop - s.rows.start) // 10)
        clear[s.rows.start : s.rows.start + loose] = 0.0
        clear[s.rows.stop - loose : s.rows.stop] = 0.0
    # as much of friction as acts, too, is no constant
    usual = float(np.sqrt(np.mean(v**2))) + 1e-12
    beside = np.stack([np.tanh(v / (_STOPPED * usual)), v / usual], axis=1)
    both = np.stack([error, motion.unexplained[:, drive.dof]], axis=1) * clear[:, None]
    columns = np.hstack([constant, beside]) * clear[:, None]
    gram = columns.T @ columns
    gram[-2:, -2:] += _RIDGE * len(motion) * np.eye(2)
    found = np.linalg.solve(gram, columns.T @ both)
    alone, force = (both - columns @ found).T
    gain = float(alone @ force / (alone @ alone + 1e-300))
    return _Integrals(error, found[:-2, 0], found[:-2, 1], gain)


def gain(motion: Motion, actuator: str) -> float:
    """Integral gain that the forces on a drive's joint say, of the joint [N·m/(rad·s)]."""
    return _integrals(motion, actuator).gain


def swing(motion: Motion, actuator: str) -> Float[np.ndarray, " sample"]:
    """Integral of a drive's position error about its mean in each segment, (T,) [rad·s]."""
    error = _integrals(motion, actuator).error.copy()
    for s in motion.segments:
        error[s.rows] -= error[s.rows].mean()
    return error


def integral(motion: Motion, actuator: str, ki: float) -> Float[np.ndarray, " sample"]:
    """Integral of a drive's position error along a motion, (T,) [rad·s].

    A servo has been on for some time when a recording begins, or for none: what the drive lacks on
    the mean of a segment says how long. What another force adds to that a replay forgets within
    kp / ki.

    Args:
        motion: the recordings.
        actuator: the drive's name.
        ki: its integral gain, of the joint [N·m/(rad·s)].
    """
    known = _integrals(motion, actuator)
    begin = known.of_force / max(ki, 1e-9) - known.of_error
    total = known.error.copy()
    for i, s in enumerate(motion.segments):
        total[s.rows] += begin[i]
    return total
