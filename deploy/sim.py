"""The simulated Go2 on the line: the same topics as the real one's, in real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deploy.dds import DdsParticipant
from deploy.go2 import LOW_COMMAND, LOW_STATE
from deploy.idl import LowCmd_, LowState_
from deploy.mischief import Mischief
from deploy.record import Recorder
from deploy.script import Script
from deploy.sim_robot import JOINTS, TICK, SimRobot, columns

_EXTRA = ("heard", "stale", "stiffness", "damping", "wall", "withheld")
_BEHIND = 0.05  # s that are made up for; a machine that was busy for longer leaves out the rest


@dataclass(frozen=True)
class WalkSummary:
    """Summary of a walk, along the heading that it had when it was first heard of.

    Attributes:
        forward: [m].
        left: [m].
        turned: to the left [rad].
        height: of the trunk, at the end [m].
        tilt: the largest between the trunk's vertical and the world's [rad].
        seconds: since the first command [s].
    """

    forward: float
    left: float
    turned: float
    height: float
    tilt: float
    seconds: float

    def __str__(self) -> str:
        """One line."""
        return (
            f"{self.seconds:.1f} s: {self.forward:+.2f} m forward, {self.left:+.2f} m left, turned "
            f"{self.turned:+.2f} rad; height {self.height:.2f} m, largest tilt {self.tilt:.2f} rad"
        )


class Sim:
    """Physics and network, tick by tick.

    Attributes:
        robot: the physics.
        recorder: what happened in every tick, with the pose of the trunk.
    """

    def __init__(
        self, line: DdsParticipant, script: Script, mischief: Mischief | None = None,
        robot: SimRobot | None = None,
    ) -> None:  # fmt: skip
        """Lie down and listen; states are sent from the first :meth:`run` on.

        Args:
            line: the network.
            script: of the remote control; its clock starts with the first command heard.
            mischief: what goes wrong, on the same clock.
            robot: the physics; None for the published ones, on the floor.
        """
        self.robot = robot or SimRobot()
        self._script, self._mischief = script, mischief
        self._inbox = line.inbox(LOW_COMMAND, LowCmd_)
        self._writer = line.writer(LOW_STATE, LowState_)
        self.recorder = Recorder(columns(), JOINTS, _EXTRA)
        self._first: float | None = None

    def run(self, until: Callable[[float], bool]) -> None:
        """Run until ``until`` says so, which is asked with the seconds since the first command.

        It runs as fast as time: a few ticks that were missed are made up for. Of more, the physics
        takes no notice, and the robot's clock goes on as if they had been.
        """
        due = time.monotonic()
        while not until(self._elapsed()):
            late = time.monotonic() - due
            if late > _BEHIND:
                missed = round(late / TICK)
                self.robot.missed += missed * TICK
                due += missed * TICK
            self._tick()
            due += TICK
            time.sleep(max(0.0, due - time.monotonic()))

    def walk(self) -> WalkSummary:
        """The robot's walk so far."""
        ticks = self.recorder.ticks()
        x, y, height, *quaternion = (ticks[f"qpos/base/{k}"] for k in range(7))
        heading = _heading(*quaternion)
        cos, sin = np.cos(heading[0]), np.sin(heading[0])
        dx, dy = x[-1] - x[0], y[-1] - y[0]
        tilt = np.arccos(np.clip(1 - 2 * (quaternion[1] ** 2 + quaternion[2] ** 2), -1, 1))
        return WalkSummary(
            forward=float(cos * dx + sin * dy),
            left=float(cos * dy - sin * dx),
            turned=float(np.unwrap(heading)[-1] - heading[0]),
            height=float(height[-1]),
            tilt=float(tilt.max()),
            seconds=float(ticks["t"][-1] - ticks["t"][0]),
        )

    def _elapsed(self) -> float:
        """Seconds since the first command; zero before it."""
        return 0.0 if self._first is None else self.robot.time - self._first

    def _tick(self) -> None:
        robot, now = self.robot, time.monotonic()
        heard = sum(robot.hear(message, now) for message in self._inbox.take())
        if heard and self._first is None:
            self._first = robot.time
        elapsed = self._elapsed()
        message = robot.state(self._script.at(elapsed).pack())
        values, when = robot.truth(), robot.time
        # before the first command nothing goes wrong
        at = elapsed if self._first is not None else -1.0
        sent = [message] if self._mischief is None else list(self._mischief.pass_on(message, at))
        for state in sent:
            self._writer.write(state)
        robot.step(now)
        if self._first is None:
            return
        command = robot.command
        extra = (
            float(heard), float(robot.stale), command.stiffness.max(), command.damping.max(), now,
            float(not sent),
        )  # fmt: skip
        self.recorder.row(elapsed, when, values, command, extra)


def _heading(w: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Turn about the vertical [rad]."""
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
