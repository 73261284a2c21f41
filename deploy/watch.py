"""Listens to the robot and checks what it hears."""

from __future__ import annotations

from deploy import safety
from deploy.ageing import Ageing
from deploy.robot import Robot, State
from deploy.safety import Limits
from deploy.stages import Fault
from wt.errors import WorkError


class Watch:
    """The newest state of a robot, and its first fault.

    Attributes:
        state: the newest; None before the first.
        fresh: whether it came in this tick.
        age: how old it is [s].
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        """Watch ``robot``; nothing was heard yet."""
        self._robot, self._limits, self._ageing = robot, limits, Ageing()
        self.state: State | None = None
        self._before: State | None = None
        self.fresh, self.age = False, float("inf")

    @property
    def clock_counts(self) -> bool:
        """True if the robot's clock tells the age of its states."""
        return self._ageing.counts()

    def listen(self, now: float) -> None:
        """Take what came since the last tick; ``now`` is the runner's time [s]."""
        state = self._robot.read()
        self.fresh = state is not None
        if state is not None:
            self._before, self.state = self.state, state
            self._ageing.heard(now, state.time)
        self.age = self._ageing.age(now)

    def known(self) -> State:
        """The newest state.

        Raises:
            WorkError: none has come yet.
        """
        if self.state is None:
            raise WorkError("no state of the robot has come yet")
        return self.state

    def first_fault(self) -> Fault | None:
        """The first thing that is wrong."""
        if words := safety.intruded(self._robot.intruders()):
            return Fault("intruder", words)
        if words := safety.stale(self.age, self._limits.stale_state):
            return Fault("stale_state", f"the robot's state is {words}")
        if self.state is None or not self.fresh:
            return None
        faults = safety.faults(self.state, self._before, self._robot.drives, self._limits)
        return next((Fault(name, words) for name, words in faults), None)
