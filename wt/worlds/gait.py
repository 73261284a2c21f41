"""The rhythm to which a policy may walk: when each foot is to stand and when to swing.

A policy with a gait sees a clock beside its observation and command. It is a function of the time
since the robot started and of the command alone, so it says nothing about the robot's state, and
whoever runs the policy can compute it: ``(sin 2πt/T, cos 2πt/T)``, and zeros while the robot is
told to stand. Half a period later left and right have exchanged their parts. As in Siekmann et al.
2021 (periodic rewards) and unitree_rl_gym, which pays a foot for standing or swinging in its turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt.errors import ConfigError

Array = np.ndarray

CLOCK = ("sin", "cos")
"""Channels of the clock."""
_MOVING = 0.1  # m/s and rad/s: a smaller command means to stand still


def moving(command: Array) -> Array:
    """Which robots are told to move, (N,) bool, by commands (N, 3) [m/s, m/s, rad/s]."""
    out: Array = np.abs(command).max(1) > _MOVING
    return out


def clock(period: float, time: Array, command: Array) -> Array:
    """What a policy sees of the rhythm, (N, 2), float32: :data:`CLOCK`.

    Args:
        period: of the rhythm, T [s].
        time: since each robot started, (N,) [s].
        command: (N, 3) [m/s, m/s, rad/s].
    """
    angle = 2 * np.pi * time / period
    both = np.stack([np.sin(angle), np.cos(angle)], axis=1) * moving(command)[:, None]
    return np.asarray(both, np.float32)


@dataclass(frozen=True)
class Gait:
    """A rhythm (``gait:``).

    Attributes:
        period: time from one step of a foot to its next [s].
        stance: share of it that a foot stands.
    """

    period: float = 0.8
    stance: float = 0.55

    def __post_init__(self) -> None:
        """Refuse a rhythm without steps."""
        if not 0.1 <= self.period < np.inf:
            raise ConfigError(f"gait.period is {self.period} s; 0.1 or more is needed")
        if not 0 < self.stance < 1:
            raise ConfigError(f"gait.stance is {self.stance}; a share between 0 and 1 is needed")

    def swing(self, time: Array, turns: tuple[float, ...]) -> Array:
        """How far each foot is in its swing, (N, F), float32: 0 … 1, and −1 while it is to stand.

        Args:
            time: since each robot started, (N,) [s].
            turns: when each of F feet begins to stand, as a share of the period.
        """
        phase = (time[:, None] / self.period - np.array(turns)) % 1.0
        swing = (phase - self.stance) / (1 - self.stance)
        return np.where(phase < self.stance, -1.0, swing).astype(np.float32)
