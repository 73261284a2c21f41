"""The commands of the drives in each stage."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from deploy import safety
from deploy.robot import Command, Drives, Joints, State
from deploy.safety import Limits
from deploy.stages import Fault, Stage

DAMPING = 4.0
"""Velocity gain that brakes a joint [N·m·s/rad]."""

_PATIENCE = 0.001  # s that a tick waits for an action; later ones look again


@runtime_checkable
class Source(Protocol):
    """Where targets come from once it stands: a policy's pilot, or a playback of commands.

    Attributes:
        pose: that is stood up to [rad].
        gains: position and velocity gains of the drives [N·m/rad, N·m·s/rad].
        rate_hz: how often it is asked.
        seconds: how long each answer took to compute [s].
        over: whether it has nothing more to say, which ends the run.
    """

    pose: Joints
    gains: tuple[Joints, Joints]
    rate_hz: float
    seconds: list[float]

    @property
    def over(self) -> bool:
        """See the class."""

    def begin(self) -> None:
        """Start anew."""

    def ask(self, state: State, command: np.ndarray) -> None:
        """Have the next answer computed, in a state and under a velocity command (3,)."""

    def answer(self, wait: float) -> np.ndarray | None:
        """What was asked for last; None if it is not there after ``wait`` [s]."""

    def targets(self, action: np.ndarray) -> Joints:
        """Joint targets of an answer [rad]."""


class MotionController:
    """Standing up, and moving as the source of targets says.

    Attributes:
        source: of the targets.
    """

    def __init__(self, source: Source, drives: Drives, limits: Limits, period: float) -> None:
        """Nothing moves yet.

        Args:
            source: of the targets, its joints in the order of ``drives``.
            drives: what the robot can take.
            limits: how far a target may go.
            period: of the control loop [s].
        """
        self.source, self._drives, self._limits, self._period = source, drives, limits, period
        self._gains, self._pose = source.gains, source.pose
        self._none = np.zeros_like(self._pose)
        self._wanted = self._start = self._target = self._pose
        self._since = self._due = self._asked = 0.0
        self._waiting = False

    def begin(self, stage: Stage, now: float, state: State) -> None:
        """Enter a stage at ``now`` [s], with the robot in ``state``."""
        self._since = now
        if stage is Stage.STAND:
            self._start = self._target = state.position
        elif stage is Stage.POLICY:
            self.source.begin()
            self._due, self._waiting, self._wanted = now, False, self._pose

    def stands(self, now: float, state: State) -> bool:
        """True once a robot that began to stand up has arrived at the standing pose."""
        off = float(np.abs(state.position - self._pose).max())
        rose = now - self._since >= self._limits.stand_seconds
        return rose and off <= self._limits.stand_error

    def think(self, now: float, state: State, velocity_command: np.ndarray) -> Fault | None:
        """Ask the source at its rate, and take its action: mostly within the same tick.

        Args:
            now: time [s].
            state: of the robot.
            velocity_command: velocity command, (3,) [m/s, m/s, rad/s].

        Returns:
            What is wrong with the answer, if anything is.
        """
        # half a loop's period early is better than one late; what was missed is not made up for
        ask = not self._waiting and now >= self._due - self._period / 2
        if ask:
            period = 1 / self.source.rate_hz
            self._due = max(self._due + period, now + period / 2)
            self._asked, self._waiting = now, True
            self.source.ask(state, velocity_command)
        if not self._waiting:
            return None
        action = self.source.answer(_PATIENCE if ask else 0.0)
        if action is None:
            words = safety.overdue(now - self._asked, self._limits.deadline)
            return Fault("deadline", words) if words else None
        self._waiting = False
        if words := safety.bad_action(action, len(self._pose)):
            return Fault("action", words)
        self._wanted = self.source.targets(action)
        return None

    def command(self, stage: Stage, now: float, state: State) -> Command:
        """Command of the drives at ``now`` [s]."""
        if stage is Stage.PASSIVE:
            return Command(self._none, self._none, self._none)
        if stage is Stage.DAMPING:
            return self.brake()
        wanted = self._wanted if stage is Stage.POLICY else self._rising(now)
        wanted = safety.within_range(wanted, self._drives, self._limits.range_margin)
        self._target = safety.slewed(wanted, self._target, self._limits.slew * self._period)
        command = Command(self._target, *self._gains)
        return Command(safety.within_torque(command, state, self._drives.torque), *self._gains)

    def brake(self) -> Command:
        """Brake every joint, hold none."""
        return Command(self._none, self._none, np.full_like(self._none, DAMPING))

    def _rising(self, now: float) -> Joints:
        """From where the joints were to the standing pose, slow at both ends."""
        share = min(1.0, (now - self._since) / self._limits.stand_seconds)
        return self._start + (self._pose - self._start) * (3 - 2 * share) * share**2
