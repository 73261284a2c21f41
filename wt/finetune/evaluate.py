"""The paper's three figures of a policy in R, on one recorded sequence of commands.

All can be computed from what a robot itself measures. A robot that falls counts until it falls, and
is said to have fallen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wt.locomotion.config import Policy as Config
from wt.locomotion.env import make_herd
from wt.worlds.legged import Start
from wt.worlds.policy import Policy

Array = np.ndarray

_START = Start(joints=0.05)


@dataclass(frozen=True)
class Downstream:
    """Figures of one policy, means over episodes.

    Attributes:
        tracking: root mean square of commanded − measured turning rate [rad/s].
        stability: √(σ²(pitch) + σ²(roll)) over time [rad].
        power: mean of |τ · q̇| over time [W].
        fallen: share of episodes in which the robot fell.
    """

    tracking: float
    stability: float
    power: float
    fallen: float


def commands(rows: Sequence[Sequence[float]], dt: float) -> Array:
    """A sequence of commands, one per control step, (T, 3), float32.

    Args:
        rows: how long [s] which command holds: forward, sideways [m/s], turn [rad/s].
        dt: control step [s].
    """
    held = [np.tile(np.array(row[1:], np.float32), (round(row[0] / dt), 1)) for row in rows]
    return np.concatenate(held)


def evaluate(
    reality: Config, policy: Policy, rows: Sequence[Sequence[float]], episodes: int, seed: int
) -> Downstream:
    """Let a policy follow the commands in R, each episode from another start.

    Args:
        reality: R's robot, physics and scene.
        policy: what walks.
        rows: of :func:`commands`.
        episodes: robots, side by side.
        seed: of the starts.
    """
    herd = make_herd(reality, episodes)
    torque = herd.batch.bind("actuator_force")
    herd.reset(np.arange(episodes), np.random.default_rng(seed), _START)
    clock, up = policy.clock(episodes), np.ones(episodes, bool)
    error, power, tilt, counts = [], [], [], []
    for command in commands(rows, herd.dt):
        told = np.tile(command, (episodes, 1))
        herd.step(policy.act(herd.observe(), told, clock.read(herd.time, told)))
        up &= ~herd.fallen()
        counts.append(up.copy())
        error.append(herd.velocity()[:, 2] - command[2])
        power.append(np.abs((torque * herd.joint_vel).sum(axis=1)))  # |τ · q̇|
        tilt.append(pitch_and_roll(herd.gravity()))
    whole = figures(np.array(error), np.array(tilt), np.array(power), np.array(counts))
    return Downstream(*whole, fallen=float(1 - up.mean()))


def figures(error: Array, tilt: Array, power: Array, up: Array) -> tuple[float, float, float]:
    """Tracking, stability and power, means over the episodes that stood at all.

    Args:
        error: of the turning rate, (T, episodes) [rad/s].
        tilt: pitch and roll, (T, episodes, 2) [rad].
        power: |τ · q̇|, (T, episodes) [W].
        up: which robots have not fallen yet, (T, episodes) bool.
    """
    rows = []
    for k in np.flatnonzero(up.any(axis=0)):
        stood = up[:, k]
        spread = np.sqrt(tilt[stood, k].var(axis=0).sum())
        rows.append((np.sqrt(np.mean(error[stood, k] ** 2)), spread, power[stood, k].mean()))
    if not rows:
        return float("nan"), float("nan"), float("nan")
    tracking, stability, mean_power = np.mean(rows, axis=0)
    return float(tracking), float(stability), float(mean_power)


def pitch_and_roll(gravity: Array) -> Array:
    """Pitch and roll of trunks, (N, 2) [rad], from the direction of gravity in their frames."""
    x, y, z = gravity.T
    return np.stack([np.arctan2(x, np.hypot(y, z)), np.arctan2(-y, -z)], axis=1)
