"""The rhythm to which a policy may walk: the times at which each foot stands and swings.

A policy with a gait sees a clock beside its observation and command: ``(sin 2πt/T, cos 2πt/T)``,
where t is the time since the robot started, and zeros while it rests. It runs while the robot is
told to move, then on for a last period and to the next moment at which a foot has come down: a
robot that is told to stop in the middle of a step takes the steps that stop it. So it depends on
time and commands alone and says nothing about the robot's state; any runner of the policy can
compute it.
Half a period later left and right have exchanged their parts. As in Siekmann et al. 2021 (periodic
rewards) and unitree_rl_gym, which pays a foot for standing or swinging in its turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from wt.errors import ConfigError

CLOCK = ("sin", "cos")
"""Channels of the clock."""
_EPSILON = 1e-6  # s, against rounding
_SETTLE = 0.05  # of a period, that both feet are down before the clock rests
_MOVING = 0.1  # m/s and rad/s: a smaller command means to stand still


def moving(command: Float[np.ndarray, "robot command=3"]) -> Bool[np.ndarray, " robot"]:
    """True where a command [m/s, m/s, rad/s] asks the robot to move, and not to stand."""
    out: np.ndarray = np.abs(command).max(1) > _MOVING
    return out


@dataclass(frozen=True)
class Gait:
    """A rhythm (``gait:``).

    Attributes:
        period: time from one step of a foot to its next [s].
        stance: share of it that a foot stands.
        rests: whether the clock rests while the robot is told to stand; else it steps on the spot.
    """

    period: float = 0.8
    stance: float = 0.55
    rests: bool = True

    def __post_init__(self) -> None:
        """Refuse a rhythm without steps."""
        if not 0.1 <= self.period < np.inf:
            raise ConfigError(f"gait.period is {self.period} s; 0.1 or more is needed")
        if not 0 < self.stance < 1:
            raise ConfigError(f"gait.stance is {self.stance}; a share between 0 and 1 is needed")

    def swing(
        self, time: Float[np.ndarray, " robot"], turns: tuple[float, ...]
    ) -> Float32[np.ndarray, "robot foot"]:
        """Share of its swing that each foot has behind it: 0 … 1, and −1 while it is to stand.

        Args:
            time: since each robot started [s].
            turns: beginning of each foot's stance, as a share of the period.
        """
        phase = (time[:, None] / self.period - np.array(turns)) % 1.0
        swing = (phase - self.stance) / (1 - self.stance)
        return np.where(phase < self.stance, -1.0, swing).astype(np.float32)


class GaitClock:
    """The clocks of many robots.

    Attributes:
        running: true where a robot steps: its clock runs, or without a rhythm it is told to move.
    """

    running: Bool[np.ndarray, " robot"]

    def __init__(self, period: float | None, size: int, rests: bool = True) -> None:
        """All rest.

        Args:
            period: of the rhythm, T [s]; None for a policy without.
            size: number of robots.
            rests: whether clocks rest while their robots are told to stand.
        """
        self._period, self._rests = period, rests
        self.running = np.zeros(size, bool)
        self._until, self._last = np.zeros(size), np.zeros(size)

    def read(
        self, time: Float[np.ndarray, " robot"], command: Float[np.ndarray, "robot command=3"]
    ) -> Float32[np.ndarray, "robot clock"]:
        """The policy's view of the rhythm; to be called once a control step.

        Args:
            time: since each robot started [s].
            command: velocities [m/s, m/s, rad/s].

        Returns:
            The channels :data:`CLOCK`; none without a rhythm.
        """
        moves = moving(command)
        if self._period is None:
            self.running = moves
            return np.empty((len(command), 0), np.float32)
        self._until[time < self._last] = 0.0  # who started anew
        self._last = time.copy()
        # at half periods a foot comes down; a little later both carry
        last = (np.ceil(2 * time / self._period) / 2 + 1 + _SETTLE) * self._period
        self._until = np.where(moves, last, self._until)
        self.running = moves | (time < self._until - _EPSILON) | (not self._rests)
        angle = 2 * np.pi * time / self._period
        both = np.stack([np.sin(angle), np.cos(angle)], axis=1) * self.running[:, None]
        return np.asarray(both, np.float32)
