"""A robot, an operator and a clock that exist in one process only, and free DDS domains."""

from __future__ import annotations

import random
import socket
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest

from deploy import go2
from deploy.dds import LARGEST_DOMAIN
from deploy.remote import Remote
from deploy.robot import Command, State
from deploy.stages import Wish
from wt.worlds.robots import GO2

TICK = 0.002
QUICK = "stand_seconds=1"
LENIENT = (QUICK, "stale_state=2", "deadline=2")
"""For tests of other things, on machines that stop for a while."""


class FakeClock:
    """Time that passes when somebody sleeps, and not otherwise."""

    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    def sleep_until(self, then: float) -> None:
        self.time = max(self.time, then)


class FakeRobot:
    """A robot that does at once what it is told, and reports what a test wants it to.

    Attributes:
        sent: every command, with its time.
        change: from time and state to the state that is reported, None for none.
        others: commands of somebody else that come in the next tick.
    """

    def __init__(self, clock: FakeClock) -> None:
        self.joints = GO2.joints
        self.drives = go2.drives(GO2.joints)
        self.sent: list[tuple[float, Command]] = []
        self.change: Callable[[float, State], State | None] = lambda _, state: state
        self.others = 0
        self._clock = clock
        self._position = np.array([0.0, 1.36, -2.65] * 4)

    def read(self) -> State | None:
        return self.change(self._clock.now(), standing(self._clock.now(), self._position))

    def send(self, command: Command) -> None:
        self.sent.append((self._clock.now(), command))
        if command.stiffness.any():
            self._position = command.target

    def intruders(self) -> int:
        return self.others

    def health(self) -> Mapping[str, int]:
        return {}


class FakeOperator:
    """Says what a list of (seconds since its beginning, wish) says."""

    def __init__(self, clock: FakeClock, *wishes: tuple[float, Wish]) -> None:
        self._clock, self._wishes = clock, deque(sorted(wishes, key=lambda w: w[0]))
        self._begin: float | None = None
        self.velocity = np.zeros(3)
        self.interrupted = False

    def ended(self) -> bool:
        return self.interrupted

    def poll(self, remote: Remote) -> tuple[Wish | None, np.ndarray]:
        self._begin = self._clock.now() if self._begin is None else self._begin
        if self._wishes and self._clock.now() - self._begin >= self._wishes[0][0]:
            return self._wishes.popleft()[1], self.velocity
        return None, self.velocity


def standing(time: float, position: np.ndarray | None = None) -> State:
    """A state without anything wrong."""
    n = len(GO2.joints)
    return State(
        time=time,
        position=np.array(GO2.default) if position is None else position.astype(float),
        velocity=np.zeros(n),
        torque=np.zeros(n),
        quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        gyro=np.zeros(3),
        temperature=np.full(n, 30.0),
        battery=90.0,
        remote=Remote(),
    )


def at_joint(values: np.ndarray, joint: int, value: float) -> np.ndarray:
    """A copy with one other value."""
    copy = values.copy()
    copy[joint] = value
    return copy


def changed(**fields: object) -> Callable[[State], State]:
    """A state with other fields."""
    return lambda state: replace(state, **fields)  # type: ignore[arg-type]


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def robot(clock: FakeClock) -> FakeRobot:
    return FakeRobot(clock)


@pytest.fixture
def domain() -> Iterator[int]:
    """A DDS domain that nobody on this machine uses: its first ports are free."""
    candidates = random.sample(range(1, LARGEST_DOMAIN), 50)
    for found in candidates:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * found))
            except OSError:
                continue
        yield found
        return
    pytest.fail("no DDS domain is free on this machine")
