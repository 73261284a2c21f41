"""The commands of the drives in each stage."""

from __future__ import annotations

import numpy as np

from deploy import safety
from deploy.pilot import Pilot
from deploy.robot import Command, Drives, Joints, State
from deploy.safety import Limits
from deploy.stages import Fault, Stage

DAMPING = 4.0
"""Velocity gain that brakes a joint [N·m·s/rad]."""

_PATIENCE = 0.001  # s that a tick waits for an action; later ones look again


class MotionController:
    """Standing up, and walking as the policy says.

    Attributes:
        pilot: the policy.
    """

    def __init__(self, pilot: Pilot, drives: Drives, limits: Limits, period: float) -> None:
        """Nothing moves yet.

        Args:
            pilot: the policy, whose joints are in the order of ``drives``.
            drives: what the robot can take.
            limits: how far a target may go.
            period: of the control loop [s].
        """
        self.pilot, self._drives, self._limits, self._period = pilot, drives, limits, period
        self._gains = np.array(pilot.card.stiffness), np.array(pilot.card.velocity_gain)
        self._pose = np.array(pilot.card.default)
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
            self.pilot.begin()
            self._due, self._waiting, self._wanted = now, False, self._pose

    def stands(self, now: float, state: State) -> bool:
        """True once a robot that began to stand up has arrived at the standing pose."""
        off = float(np.abs(state.position - self._pose).max())
        rose = now - self._since >= self._limits.stand_seconds
        return rose and off <= self._limits.stand_error

    def think(self, now: float, state: State, velocity_command: np.ndarray) -> Fault | None:
        """Ask the policy at its rate, and take its action: mostly within the same tick.

        Args:
            now: time [s].
            state: of the robot.
            velocity_command: velocity command, (3,) [m/s, m/s, rad/s].

        Returns:
            What is wrong with the policy, if anything is.
        """
        # half a loop's period early is better than one late; what was missed is not made up for
        ask = not self._waiting and now >= self._due - self._period / 2
        if ask:
            period = 1 / self.pilot.card.rate_hz
            self._due = max(self._due + period, now + period / 2)
            self._asked, self._waiting = now, True
            self.pilot.ask(state, velocity_command)
        if not self._waiting:
            return None
        action = self.pilot.answer(_PATIENCE if ask else 0.0)
        if action is None:
            words = safety.overdue(now - self._asked, self._limits.deadline)
            return Fault("deadline", words) if words else None
        self._waiting = False
        if words := safety.bad_action(action, len(self._pose)):
            return Fault("action", words)
        self._wanted = self.pilot.targets(action)
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
