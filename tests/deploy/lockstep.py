"""The runner and the simulated Go2 in one process, tick by tick: the same recording every time.

Over the network they are two programs in real time; here physics pass while the runner sleeps, and
a command is heard in the tick in which it is sent. Pilot, control loop, messages, drives and
recorder are those of ``wt-run`` and ``wt-sim-go2``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from deploy import go2
from deploy.idl import LowCmd_
from deploy.job import MODEL
from deploy.pilot import Pilot
from deploy.record import RECORDING
from deploy.remote import Remote
from deploy.robot import Command, State
from deploy.runner import RATE_HZ, Runner
from deploy.safety import Limits
from deploy.sim_robot import JOINTS, TICK, SimRobot
from deploy.stages import Wish
from wt.worlds import go2_model
from wt.worlds.policy import Policy
from wt.worlds.robots import GO2, mjcf

Edit = Callable[[mujoco.MjSpec], None]
STAND_AT, RISE, MOVE_AT, END = 0.1, 1.5, 1.8, 7.8  # s
LIMITS = Limits(stand_seconds=RISE, deadline=60.0)
_PATIENCE_S = 60.0


@dataclass(frozen=True)
class Hidden:
    """In what the robot differs from the published one.

    Attributes:
        edit: of its MJCF.
        strength: joint → share of its torque that its drive gives.
    """

    edit: Edit = lambda spec: None
    strength: Mapping[str, float] = field(default_factory=dict)


NOTHING = Hidden()
Velocity = Callable[[float], np.ndarray]
"""Seconds since it began to move → command (3,): forward, left [m/s], turn [rad/s]."""


class _Patient(Pilot):
    """Waits for its policy however busy the machine is: the robot's clock stands meanwhile."""

    def answer(self, wait: float) -> np.ndarray | None:
        return super().answer(_PATIENCE_S)


@dataclass(frozen=True)
class Motion:
    """What the robot does after it stood up.

    Attributes:
        pilot: from the policy of the package to who pilots.
        velocity: the operator's command.
    """

    pilot: Callable[[Policy], Pilot] = _Patient
    velocity: Velocity = lambda t: np.zeros(3)


def loaded(mass: float, place: tuple[float, float, float]) -> Hidden:
    """A block on the trunk [kg], at [m] in its frame."""

    def edit(spec: mujoco.MjSpec) -> None:
        load = spec.body(go2_model.TRUNK).add_body(name="load", pos=place)
        load.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.06, 0.04, 0.03], mass=mass,
            contype=0, conaffinity=0,
        )  # fmt: skip

    return Hidden(edit)


def late(seconds: float) -> Hidden:
    """Drives that take every target so late [s]."""

    def edit(spec: mujoco.MjSpec) -> None:
        for drive in spec.actuators:
            drive.delay, drive.nsample = seconds, round(seconds / spec.option.timestep) + 1

    return Hidden(edit)


class LockstepRobot:
    """The simulated Go2 as the runner sees it, and its clock: :class:`deploy.robot.Robot`."""

    def __init__(self, hidden: Hidden = NOTHING, hung: bool = False) -> None:
        self.joints, self.drives = JOINTS, go2.drives(JOINTS)
        self._sim, self._motor = SimRobot(hidden.edit, hung), go2.motors(JOINTS)
        self._strength = np.array([hidden.strength.get(j, 1.0) for j in JOINTS])
        self._ticks = 0

    def truth(self) -> np.ndarray:
        """As :meth:`deploy.sim_robot.SimRobot.truth`."""
        return self._sim.truth()

    def now(self) -> float:
        return self._ticks * TICK

    def sleep_until(self, then: float) -> None:
        while self.now() < then - 0.5 * TICK:
            self._sim.step(self.now())
            self._ticks += 1

    def read(self) -> State | None:
        return go2.unpack(self._sim.state(Remote().pack()), self._motor)

    def send(self, command: Command) -> None:
        message = LowCmd_()
        sent = message.data["motor_cmd"]
        sent["q"][self._motor] = command.target
        sent["kp"][self._motor] = self._strength * command.stiffness
        sent["kd"][self._motor] = self._strength * command.damping
        self._sim.hear(message.seal(), self.now())

    def intruders(self) -> int:
        return 0

    def health(self) -> Mapping[str, int]:
        return {}


class LockstepOperator:
    """Stands up, moves, and ends; commands as told: :class:`deploy.runner.Operator`."""

    def __init__(self, clock: LockstepRobot, velocity: Velocity = lambda t: np.zeros(3)) -> None:
        self._clock, self._velocity = clock, velocity
        self._wishes = [(STAND_AT, Wish.STAND), (MOVE_AT, Wish.POLICY)]
        self._begin: float | None = None

    def poll(self, remote: Remote) -> tuple[Wish | None, np.ndarray]:
        self._begin = self._clock.now() if self._begin is None else self._begin
        passed = self._clock.now() - self._begin
        wish = self._wishes.pop(0)[1] if self._wishes and passed >= self._wishes[0][0] else None
        return wish, self._velocity(passed - MOVE_AT)

    def ended(self) -> bool:
        return False


class _Swaying(_Patient):
    """Sways on its feet instead of walking: every joint goes to and fro about the pose."""

    def __init__(self, policy: Policy, rng: np.random.Generator) -> None:
        super().__init__(policy)
        # hips and knees mostly together, or its feet would slide
        legs, own = rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, (3, 12))
        size = np.tile([0.06, 0.12, 0.12], 4) / np.array(policy.card.action_scale)
        self._waves = size * (np.tile(legs, 4) + 0.25 * own)
        self._turns = rng.uniform(0.3, 1.5, 3)

    def answer(self, wait: float) -> np.ndarray | None:
        super().answer(wait)
        t = self._steps / self.card.rate_hz
        return np.float32(np.sin(2.0 * np.pi * self._turns * t) @ self._waves)


def walk(*velocity: float) -> Motion:
    """At a command (forward, left [m/s], turn [rad/s]) that comes within a second."""
    return Motion(velocity=lambda t: min(max(t, 0.0), 1.0) * np.array(velocity))


def sway(seed: int) -> Motion:
    """On its feet, by three waves."""
    return Motion(lambda policy: _Swaying(policy, np.random.default_rng(seed)))


def record(motion: Motion, folder: Path, hidden: Hidden = NOTHING) -> tuple[Path, Path]:
    """What ``wt-run`` leaves of a run: the MJCF of the robot, and a recording.

    Args:
        motion: what it does after it stood up.
        folder: where to; it is made.
        hidden: in what the robot differs from its MJCF.
    """
    robot = LockstepRobot(hidden)
    pilot = motion.pilot(Policy.load("go2", GO2))
    operator = LockstepOperator(robot, motion.velocity)
    runner = Runner(robot, pilot, operator, LIMITS, robot, lambda line: None)
    outcome = runner.run(END)
    assert outcome.fault is None, outcome.fault
    assert [what for _, what in runner.events] == ["stand", "policy", "damping"]
    runner.recorder.write(folder, {"robot": "go2", "source": "in lockstep", "rate": RATE_HZ})
    (folder / MODEL).write_text(mjcf("go2"), encoding="utf-8")
    return folder / MODEL, folder / RECORDING
