"""The paper's three figures of a policy in R, on one recorded sequence of commands.

All can be computed from what a robot itself measures. A robot that falls counts until it falls, and
is said to have fallen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from wt.worlds.legged import Herd, Start
from wt.worlds.policy import Policy

_START = Start(joints=0.05)


@dataclass(frozen=True)
class Downstream:
    """Figures of one policy, means over episodes.

    Attributes:
        tracking: root mean square of commanded − measured turning rate [rad/s].
        stability: √(σ²(pitch) + σ²(roll)) over time [rad].
        power: mean of |τ · q̇| over time [W].
        walking: root mean square of commanded − measured horizontal velocity [m/s]; not the
            paper's, since no sensor of the robot tells it.
        fallen: share of episodes in which the robot fell.
    """

    tracking: float
    stability: float
    power: float
    walking: float
    fallen: float


def commands(rows: Sequence[Sequence[float]], dt: float) -> Float32[np.ndarray, "step 3"]:
    """A sequence of commands, one per control step.

    Args:
        rows: how long [s] which command holds: forward, sideways [m/s], turn [rad/s].
        dt: control step [s].
    """
    segments = [np.tile(np.array(row[1:], np.float32), (round(row[0] / dt), 1)) for row in rows]
    return np.concatenate(segments)


def evaluate(herd: Herd, policy: Policy, rows: Sequence[Sequence[float]], seed: int) -> Downstream:
    """Let a policy follow the commands, each robot from another start.

    Args:
        herd: of R, one robot an episode.
        policy: what walks.
        rows: of :func:`commands`.
        seed: of the starts.
    """
    episodes, torque = herd.size, herd.batch.bind("actuator_force")
    herd.reset(np.arange(episodes), np.random.default_rng(seed), _START)
    clock, up = policy.clock(episodes), np.ones(episodes, bool)
    error, power, tilt, counts, drift = [], [], [], [], []
    for command in commands(rows, herd.dt):
        robot_commands = np.tile(command, (episodes, 1))
        herd.step(policy.act(herd.observe(), robot_commands, clock.read(herd.time, robot_commands)))
        up &= ~herd.fallen()
        counts.append(up.copy())
        off = herd.velocity()[:, :3] - command
        error.append(off[:, 2])
        drift.append(np.hypot(off[:, 0], off[:, 1]))
        power.append(np.abs((torque * herd.joint_vel).sum(axis=1)))  # |τ · q̇|
        tilt.append(pitch_and_roll(herd.gravity()))
    arrays = (np.array(x) for x in (error, tilt, power, drift, counts))
    return Downstream(*figures(*arrays), fallen=float(1 - up.mean()))


def figures(
    error: Float[np.ndarray, "step episode"],
    tilt: Float[np.ndarray, "step episode 2"],
    power: Float[np.ndarray, "step episode"],
    drift: Float[np.ndarray, "step episode"],
    up: Bool[np.ndarray, "step episode"],
) -> tuple[float, float, float, float]:
    """Tracking, stability, power and walking, means over the episodes that stood at all.

    Args:
        error: of the turning rate [rad/s].
        tilt: pitch and roll [rad].
        power: |τ · q̇| [W].
        drift: error of the horizontal velocity [m/s].
        up: which robots have not fallen yet.
    """
    rows = []
    for k in np.flatnonzero(up.any(axis=0)):
        stood = up[:, k]
        spread = np.sqrt(tilt[stood, k].var(axis=0).sum())
        track, walk = (np.sqrt(np.mean(x[stood, k] ** 2)) for x in (error, drift))
        rows.append((track, spread, power[stood, k].mean(), walk))
    tracking, stability, mean_power, walking = np.mean(rows, axis=0) if rows else [np.nan] * 4
    return float(tracking), float(stability), float(mean_power), float(walking)


def pitch_and_roll(gravity: Float[np.ndarray, "robot 3"]) -> Float[np.ndarray, "robot 2"]:
    """Pitch and roll of trunks [rad], from the direction of gravity in their frames."""
    x, y, z = gravity.T
    return np.stack([np.arctan2(x, np.hypot(y, z)), np.arctan2(-y, -z)], axis=1)
