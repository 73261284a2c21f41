"""The control loop: 500 times a second, listen, check, decide, command the drives.

Each tick does all four, whatever happened before; what goes wrong is a :class:`Fault`, and what
follows a fault is damping, in the same tick and in every one until the program ends.
"""

from __future__ import annotations

import gc
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Protocol, runtime_checkable

import numpy as np

from deploy import safety
from deploy.clock import Clock, Monotonic
from deploy.motion import MotionController, Source
from deploy.record import Recorder, state_columns, state_values
from deploy.remote import Remote
from deploy.robot import Command, Robot
from deploy.safety import Limits
from deploy.stages import Fault, Stage, Status, Wish, step
from deploy.timing import Timing
from deploy.watch import Watch
from wt.errors import WorkError

RATE_HZ = 500.0
END_SECONDS = 1.0
"""Duration of damping before the program ends [s]."""

_FIRST_STATE = 10.0  # s, to wait for the robot
_LISTEN = 0.5  # s, before the first command: is the robot free, and its clock of use?
_STAGES = list(Stage)
_EXTRA = (
    "stage", "fault", "age", "stiffness", "damping", "inference",
    "command/forward", "command/left", "command/turn", "battery", "temperature",
)  # fmt: skip


@runtime_checkable
class Operator(Protocol):
    """The source of wishes and commands: :class:`deploy.operator.HumanOperator`, or a test."""

    def poll(self, remote: Remote) -> tuple[Wish | None, np.ndarray]:
        """Wish and velocity command (3,) [m/s, m/s, rad/s]."""

    def ended(self) -> bool:
        """True once a signal has asked the program to end."""


@dataclass(frozen=True)
class RunOutcome:
    """End of a run.

    Attributes:
        fault: what ended the motion, if anything did.
        timing: how regular it was.
        began: when the first tick was, by the clock [s].
    """

    fault: Fault | None
    timing: Timing
    began: float


class Runner:
    """One source of targets, one robot, one operator.

    Attributes:
        recorder: what happened in every tick.
        status: where the run is.
        events: seconds since the first tick, and what happened then.
    """

    def __init__(
        self, robot: Robot, source: Source, operator: Operator, limits: Limits,
        clock: Clock | None = None, say: Callable[[str], None] | None = None,
    ) -> None:  # fmt: skip
        """Bring them together; nothing moves before :meth:`run`.

        Args:
            robot: its joints are in the source's order.
            source: of the targets: a policy, or commands that are played.
            operator: who decides when.
            limits: when to stop.
            clock: time; None for the machine's.
            say: told what happens, without making the loop wait; None for lines on stderr.
        """
        self._robot, self._operator = robot, operator
        self._clock, self._say = clock or Monotonic(), say or teller()
        self._watch = Watch(robot, limits)
        self._motion = MotionController(source, robot.drives, limits, 1 / RATE_HZ)
        self._source = source
        self.recorder = Recorder(state_columns(robot.joints), robot.joints, _EXTRA)
        self.status = Status()
        self.events: list[tuple[float, str]] = []
        self._ages: list[float] = []
        self._began = 0.0

    def run(
        self, seconds: float = math.inf, brake: float = END_SECONDS, stay: bool = True
    ) -> RunOutcome:
        """Run until the operator ends it; damping is the last that the drives are told.

        Args:
            seconds: end after so long, as if the operator had asked.
            brake: how long damping is told in the end [s].
            stay: tell damping after a fault until the operator ends it, too; otherwise a fault
                ends the run, as is right where nothing can fall.

        Raises:
            WorkError: no state of the robot arrives, somebody else commands it, or the operator
                ends the program before that is known; nothing was sent.
        """
        self._await_robot()
        gc.collect()
        gc.disable()  # a collection may take longer than a tick
        ticks: list[float] = []
        self._began = begin = self._clock.now()
        end, k = begin + seconds, 0
        try:
            while (now := self._clock.now()) < end + brake:
                ticks.append(now)
                wish = self._tick(now, ended=now >= end)
                if wish is Wish.QUIT or (self.status.fault and not stay):
                    end = min(end, now)
                # ticks that were missed are gone: a burst of them would help nobody
                k = max(k + 1, int((self._clock.now() - begin) * RATE_HZ))
                self._clock.sleep_until(begin + k / RATE_HZ)
        finally:
            gc.enable()
        took, ages = self._source.seconds, np.array(self._ages)
        timing = Timing.of(np.array(ticks), 1 / RATE_HZ, took, ages)
        return RunOutcome(self.status.fault, timing, begin)

    def _await_robot(self) -> None:
        """Wait for a first state, then listen for a while; send nothing."""
        self._say("waiting for the robot")
        begin, heard = self._clock.now(), math.inf
        while (now := self._clock.now()) < heard + _LISTEN:
            self._watch.listen(now)
            heard = min(heard, now) if self._watch.fresh else heard
            if words := safety.intruded(self._robot.intruders()):
                raise WorkError(f"nothing was sent: {words}")
            if self._operator.ended():
                raise WorkError("interrupted while waiting for the robot: nothing was sent")
            if now > begin + _FIRST_STATE and heard == math.inf:
                raise WorkError(
                    f"no state of the robot came for {_FIRST_STATE:g} s: is it on, and is this its "
                    "network interface and DDS domain? For a simulated one, run wt-sim-go2"
                )
            self._clock.sleep_until(now + 1 / RATE_HZ)
        if not self._watch.clock_counts:
            self._say("warning: the robot's clock does not count milliseconds: delays go unseen")

    def _tick(self, now: float, ended: bool) -> Wish | None:
        """One tick; an error of ours ends in damping, too."""
        velocity_command, command = np.zeros(3), self._motion.brake()
        ended = ended or self._source.over or self._operator.ended()
        wish = Wish.QUIT if ended else None
        try:
            self._watch.listen(now)
            asked, velocity_command = self._operator.poll(self._watch.known().remote)
            wish = wish or asked
            command = self._decide(now, wish, velocity_command)
        except Exception as error:
            self._broken(now, error)
        self._robot.send(command)
        try:
            self._note(now, command, velocity_command)
        except Exception as error:  # without a log, the drives are still to be told
            self._broken(now, error)
        return wish

    def _broken(self, now: float, error: Exception) -> None:
        self._move_on(now, None, Fault("internal", f"{type(error).__name__}: {error}"))

    def _decide(self, now: float, wish: Wish | None, velocity_command: np.ndarray) -> Command:
        state = self._watch.known()
        self._move_on(now, wish, self._watch.first_fault())
        if self.status.stage is Stage.POLICY:
            self._move_on(now, None, self._motion.think(now, state, velocity_command))
        return self._motion.command(self.status.stage, now, state)

    def _move_on(self, now: float, wish: Wish | None, fault: Fault | None) -> None:
        """Enter another stage, if it is time."""
        state = self._watch.known()
        status = step(self.status, wish, fault, self._motion.stands(now, state))
        if status == self.status:
            return
        self.status = status
        what = status.stage.value + (f": {status.fault}" if status.fault else "")
        self.events.append((now - self._began, what))
        self._say(what)
        self._motion.begin(status.stage, now, state)

    def _note(self, now: float, command: Command, velocity_command: np.ndarray) -> None:
        state, status = self._watch.known(), self.status
        self._ages.append(self._watch.age)
        seconds = self._source.seconds
        extra = (
            float(_STAGES.index(status.stage)), float(status.fault is not None),
            self._watch.age, float(command.stiffness.max()), float(command.damping.max()),
            seconds[-1] if seconds else math.nan, *velocity_command,
            state.battery, float(state.temperature.max()),
        )  # fmt: skip
        heard = state.time if self._watch.fresh else None
        self.recorder.row(now - self._began, heard, state_values(state), command, extra)


def teller() -> Callable[[str], None]:
    """Prints lines on stderr from a thread: a terminal that hangs must not stop the loop."""
    lines: SimpleQueue[str] = SimpleQueue()
    terminal = sys.stderr

    def work() -> None:
        while True:
            print(lines.get(), file=terminal, flush=True)

    Thread(target=work, daemon=True, name="teller").start()
    return lines.put
