"""Where joints may go in an experiment, and how fast: what was shown, inside what is allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.experiment.trial import Trial, command, settled
from wt.physics.scene import Scene

MILD = 0.3
"""Of joints that were never seen moving [rad, rad/s; m, m/s]."""
_EDGE = 0.05  # share of a joint's range that is left out at either end
_SLACK, _ROUNDING = 0.002, 1e-6  # share of what was recorded, and [rad or m], for simulation's sake
_NO_ROOM = 1e-4  # rad or m
_STILL = 0.02  # of the fastest: what stands


@dataclass(frozen=True, eq=False)
class Shown:
    """A motion that the machine has made.

    Attributes:
        recording: name of the recording that it is of, or a part of.
        held_out: whether that part was held out.
        q: joint positions as measured [rad or m]; NaN where they were not.
        v: joint velocities [rad/s or m/s].
        replayed: joint positions by a replay, which stand in where none were measured.
    """

    recording: str
    held_out: bool
    q: Float[np.ndarray, "sample dof"]
    v: Float[np.ndarray, "sample dof"]
    replayed: Float[np.ndarray, "sample dof"]


@dataclass(frozen=True, eq=False)
class Reach:
    """Positions and speeds that joints may have [rad, rad/s].

    Attributes:
        rest: the pose at the start and the end.
        low: smallest position.
        high: largest.
        slack: by how much a simulated motion may leave these, at either end.
        speed: greatest speed.
    """

    rest: Float[np.ndarray, " dof"]
    low: Float[np.ndarray, " dof"]
    high: Float[np.ndarray, " dof"]
    slack: Float[np.ndarray, "end dof"]
    speed: Float[np.ndarray, " dof"]

    def smaller(
        self,
        motion: Float[np.ndarray, "sample dof"],
        share: float | Float[np.ndarray, " dof"],
    ) -> Float[np.ndarray, "sample dof"]:
        """A motion around the rest, so many times its size."""
        return np.asarray(self.rest + share * (motion - self.rest))


def reach_of(scene: Scene, shown: Sequence[Shown], free: bool = False) -> Reach:
    """Reach of a machine: what it has shown, inside what its model allows.

    Args:
        scene: the machine.
        shown: its motions so far, the latest last.
        free: whether the model's ranges are known to be free of obstacles, so that joints may go
            anywhere in them; else only a little beyond what was shown.
    """
    count = len(scene.joints)
    seen_low, seen_high = np.full(count, np.inf), np.full(count, -np.inf)
    speed = np.full(count, MILD)
    for motion in shown:
        q = np.where(np.isfinite(motion.q), motion.q, motion.replayed)
        seen_low = np.fmin(seen_low, np.nanmin(q, axis=0))
        seen_high = np.fmax(seen_high, np.nanmax(q, axis=0))
        speed = np.fmax(speed, np.nanquantile(np.abs(motion.v), 0.995, axis=0))
    stands = _stands(scene, shown)
    around = 0.0 if shown else MILD  # nothing was shown: near where it stands
    seen_low = np.fmin(seen_low, stands - around)
    seen_high = np.fmax(seen_high, stands + around)
    (low, high), margin = _allowed(scene)
    known = np.isfinite([low, high])  # by the model
    rest = settled(scene, stands, 0.5 * (seen_low + seen_high))
    # what falls without end is held where it stands, and so is what nothing has shown to settle so
    lost = (rest < np.where(known[0], low - margin, seen_low)) | (
        rest > np.where(known[1], high + margin, seen_high)
    )
    rest = np.where(lost, stands, rest)
    room = np.inf if free else np.maximum(0.1 * (seen_high - seen_low), 0.0)
    low = np.where(known[0], np.maximum(low, np.minimum(seen_low - room, rest - MILD)), seen_low)
    high = np.where(
        known[1], np.minimum(high, np.maximum(seen_high + room, rest + MILD)), seen_high
    )
    low, high = np.minimum(low, rest), np.maximum(high, rest)
    slack = np.where(known, 0.1, _SLACK) * (high - low) + _ROUNDING
    return Reach(rest, low, high, slack, speed)


def roomy(reach: Reach, dof: int) -> bool:
    """Whether a joint has room to move in."""
    return bool(reach.high[dof] - reach.low[dof] > _NO_ROOM)


def _stands(scene: Scene, shown: Sequence[Shown]) -> Float[np.ndarray, " dof"]:
    """Pose in which the machine stands: at the end of the last recording, or its start.

    Where it moves at either, in the most quiet moment of its last part. Where nothing was recorded,
    in the model's first keyframe, or else at zero.
    """
    model = scene.model
    rest = (model.key_qpos[0] if model.nkey else model.qpos0).copy()
    if not shown:
        return rest
    # the last that were given are held out, as the last part of a single one is
    fitted, held_out = ([m for m in shown if m.held_out is held] for held in (False, True))
    last = [*fitted, *held_out][-1]
    first = next(m for m in [*held_out, *fitted][::-1] if m.recording == last.recording)
    speeds = [np.abs(np.nan_to_num(m.v)).max(axis=1) for m in (last, first)]
    still = _STILL * max(float(s.max()) for s in speeds)
    if speeds[0][-1] <= still:
        pose = last.q[-1]
    elif speeds[1][0] <= still:
        pose = first.q[0]
    else:
        pose = last.q[int(speeds[0].argmin())]
    return np.where(np.isfinite(pose), pose, rest)


def _allowed(
    scene: Scene,
) -> tuple[tuple[Float[np.ndarray, " dof"], Float[np.ndarray, " dof"]], Float[np.ndarray, " dof"]]:
    """Positions that joints' ranges and servos' commands allow, and the margin kept to those.

    Infinite where nothing is said.
    """
    m = scene.model
    low, high = np.full(m.njnt, -np.inf), np.full(m.njnt, np.inf)
    limited = m.jnt_limited.astype(bool)
    margin = _EDGE * np.ptp(m.jnt_range, axis=1)
    low[limited] = (m.jnt_range[:, 0] + margin)[limited]
    high[limited] = (m.jnt_range[:, 1] - margin)[limited]
    for drive in scene.drives:
        if drive.servo and drive.gain and m.actuator_ctrllimited[drive.index]:
            zero, slope = command(drive, 0.0, 0.0, 0.0), command(drive, 1.0, 0.0, 0.0)
            ends = np.sort((m.actuator_ctrlrange[drive.index] - zero) / (slope - zero))
            low[drive.dof] = max(low[drive.dof], ends[0])
            high[drive.dof] = min(high[drive.dof], ends[1])
    return (low, high), np.where(limited, margin, 0.0)


def too_far(scene: Scene, reach: Reach, tried: Trial, rate: float) -> Bool[np.ndarray, " dof"]:
    """Joints whose simulated motion has to become smaller.

    Args:
        scene: the machine.
        reach: what its joints may do.
        tried: the motion.
        rate: of its samples [Hz].
    """
    m = scene.model
    if not np.isfinite(tried.q).all() or len(tried.touched):
        return np.ones(len(scene.joints), bool)
    low, high = reach.low - reach.slack[0], reach.high + reach.slack[1]
    limited = m.jnt_limited.astype(bool)
    low[limited] = np.maximum(low, m.jnt_range[:, 0])[limited]
    high[limited] = np.minimum(high, m.jnt_range[:, 1])[limited]
    wrong: np.ndarray = np.any((tried.q < low) | (tried.q > high), axis=0)
    # between samples, since a stiff servo jumps after every held command
    speed = np.abs(np.diff(tried.q, axis=0)) * rate
    wrong |= np.any(speed > 1.3 * reach.speed, axis=0)
    for drive in scene.drives:
        i = drive.index
        for limits, values, known in (
            (m.actuator_forcerange[i], tried.force[:, i], m.actuator_forcelimited[i]),
            (m.actuator_ctrlrange[i], tried.ctrl[:, i], m.actuator_ctrllimited[i]),
        ):
            margin = 0.02 * float(np.ptp(limits))
            if known and (values.min() < limits[0] + margin or values.max() > limits[1] - margin):
                wrong[drive.dof] = True
    return wrong
