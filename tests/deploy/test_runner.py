"""The control loop on a robot and a clock that a test controls: exact to the tick."""

from __future__ import annotations

import dataclasses
import io
import math
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from deploy.pilot import Pilot
from deploy.robot import Command, Silent, State
from deploy.runner import Runner, teller
from deploy.safety import Limits
from deploy.stages import Wish
from tests.deploy.conftest import TICK, FakeClock, FakeOperator, FakeRobot, at_joint, changed
from wt.errors import WorkError
from wt.worlds.policy import Policy
from wt.worlds.robots import GO2

# Every tick counts here: with all types checked, one takes a millisecond.
LIMITS = Limits(stand_seconds=0.1, deadline=60.0)
WISHES = ((0.02, Wish.STAND), (0.14, Wish.POLICY), (0.29, Wish.QUIT))
FAULT_AT = 0.2  # s after the first tick, while the policy is at work
BRAKE = 0.1  # s of damping in the end

Change = Callable[[State], State | None]


class Rigged(Pilot):
    """The shipped policy, with answers that a test may replace."""

    def __init__(self) -> None:
        super().__init__(Policy.load("go2", GO2))
        self.rig: Callable[[np.ndarray], np.ndarray] = lambda action: action
        self.hangs: Callable[[], bool] = lambda: False

    def answer(self, wait: float) -> np.ndarray | None:
        if self.hangs():
            return None
        action = super().answer(wait=60.0)  # whatever this machine is busy with
        return None if action is None else self.rig(action)


@pytest.fixture(scope="module")
def shared_pilot() -> Rigged:
    return Rigged()


@pytest.fixture
def pilot(shared_pilot: Rigged) -> Rigged:
    """Nothing is rigged."""
    shared_pilot.hangs = lambda: False
    shared_pilot.rig = lambda action: action
    return shared_pilot


@pytest.fixture
def said() -> list[str]:
    return []


def started(
    robot: FakeRobot, pilot: Pilot, clock: FakeClock, said: list[str], limits: Limits = LIMITS
) -> Runner:
    operator = FakeOperator(clock, *WISHES)
    operator.velocity[:] = 0.5, 0.0, 0.0
    return Runner(robot, pilot, operator, limits, clock, said.append)


def is_damping(command: Command) -> bool:
    return not command.stiffness.any() and bool((command.damping > 0).all())


def commands(robot: FakeRobot, begin: float, end: float = math.inf) -> list[Command]:
    """Those that were sent in a time of the run [s]."""
    return [c for t, c in robot.sent if begin - 1e-9 <= t - robot.sent[0][0] < end - 1e-9]


def is_time(robot: FakeRobot, clock: FakeClock) -> bool:
    """Whether it is time for a fault."""
    return bool(robot.sent) and clock.now() >= robot.sent[0][0] + FAULT_AT - 1e-9


def later(robot: FakeRobot, clock: FakeClock, change: Change) -> None:
    """Change what the robot reports when it is time."""
    robot.change = lambda _, state: change(state) if is_time(robot, clock) else state


def test_a_run_from_lying_to_damping(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    before = len(pilot.seconds)
    runner = started(robot, pilot, clock, said)
    outcome = runner.run(brake=BRAKE)
    assert outcome.fault is None
    assert [what for _, what in runner.events] == ["stand", "policy", "damping"]
    when = [t for t, _ in runner.events]
    np.testing.assert_allclose(when, [at for at, _ in WISHES], atol=1.1 * TICK)
    # a command in every tick, until the end
    times = np.array([t for t, _ in robot.sent])
    np.testing.assert_allclose(np.diff(times), TICK, atol=1e-6)
    assert times[-1] - times[0] == pytest.approx(0.29 + BRAKE, abs=2 * TICK)
    for command in commands(robot, 0.0, 0.02):
        assert not command.stiffness.any() and not command.damping.any()
    for command in commands(robot, 0.02 + TICK, 0.29):
        assert command.stiffness.tolist() == pilot.card.stiffness
        assert command.damping.tolist() == pilot.card.velocity_gain
    np.testing.assert_allclose(commands(robot, 0.136)[0].target, GO2.default, atol=1e-9)
    assert all(is_damping(c) for c in commands(robot, 0.29 + TICK))
    # fifty actions a second, each of the shipped policy
    asked = outcome.timing.inference.count - before
    assert asked == 8
    assert outcome.timing.period.max == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        (
            "not_finite",
            lambda s: dataclasses.replace(s, velocity=at_joint(s.velocity, 2, math.nan)),
        ),
        ("tilt", changed(quaternion=np.array([0.7, 0.7, 0.0, 0.0]))),
        ("jump", lambda s: dataclasses.replace(s, position=s.position - 0.5)),
        ("range", lambda s: dataclasses.replace(s, position=at_joint(s.position, 2, 1.8))),
        ("speed", changed(velocity=np.full(12, 40.0))),
        ("temperature", changed(temperature=np.full(12, 99.0))),
        ("battery", changed(battery=3.0)),
        ("stale_state", lambda s: None),
        ("stale_state", lambda s: dataclasses.replace(s, time=s.time - 0.1)),
    ],
)
def test_what_is_wrong_with_the_robot_ends_in_damping_for_good(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str], name: str, change: Change
) -> None:
    later(robot, clock, change)
    outcome = started(robot, pilot, clock, said).run(brake=BRAKE)
    assert outcome.fault is not None and outcome.fault.name == name
    within = 0.002 if name != "stale_state" else LIMITS.stale_state + 0.002
    assert all(is_damping(c) for c in commands(robot, FAULT_AT + within + TICK))
    assert not any(is_damping(c) for c in commands(robot, 0.0, FAULT_AT))
    assert name in said[-1]


@pytest.mark.parametrize("stay", [True, False])
def test_a_fault_ends_a_run_only_where_nothing_can_fall(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str], stay: bool
) -> None:
    later(robot, clock, changed(battery=3.0))
    operator = FakeOperator(clock, *WISHES[:2])
    runner = Runner(robot, pilot, operator, LIMITS, clock, said.append)
    outcome = runner.run(seconds=1.0, brake=BRAKE, stay=stay)
    assert outcome.fault is not None
    last = robot.sent[-1][0] - robot.sent[0][0]
    assert last == pytest.approx((1.0 if stay else FAULT_AT) + BRAKE, abs=3 * TICK)
    assert is_damping(robot.sent[-1][1])


def test_somebody_else_s_command_ends_in_damping(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    def come(state: State) -> State:
        robot.others = 1
        return state

    later(robot, clock, come)
    outcome = started(robot, pilot, clock, said).run(brake=BRAKE)
    assert outcome.fault is not None and outcome.fault.name == "intruder"
    assert all(is_damping(c) for c in commands(robot, FAULT_AT + 2 * TICK))


@pytest.mark.parametrize(
    ("name", "rig"),
    [
        ("action", lambda action: np.full_like(action, np.nan)),
        ("action", lambda action: action[:11]),
        ("internal", lambda action: action.nonsense),
    ],
)
def test_an_action_that_cannot_be_commanded_never_is(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str], name: str,
    rig: Callable[[np.ndarray], np.ndarray],
) -> None:  # fmt: skip
    def rigged(action: np.ndarray) -> np.ndarray:
        return rig(action) if is_time(robot, clock) else action

    pilot.rig = rigged
    outcome = started(robot, pilot, clock, said).run(brake=BRAKE)
    assert outcome.fault is not None and outcome.fault.name == name
    assert all(np.isfinite(c.target).all() and c.target.shape == (12,) for _, c in robot.sent)
    # the tick that got it brakes already; one every 20 ms asks
    assert all(is_damping(c) for c in commands(robot, FAULT_AT + 0.02 + TICK))


def test_a_policy_that_hangs_misses_its_deadline(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    pilot.hangs = lambda: is_time(robot, clock)
    limits = dataclasses.replace(LIMITS, deadline=0.01)
    outcome = started(robot, pilot, clock, said, limits).run(brake=BRAKE)
    assert outcome.fault is not None and outcome.fault.name == "deadline"
    assert all(is_damping(c) for c in commands(robot, FAULT_AT + 0.02 + 0.01 + 2 * TICK))


def test_a_dry_run_computes_and_sends_nothing(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    robot._position, robot.others = np.array(GO2.default), 5
    before = len(pilot.seconds)
    runner = Runner(Silent(robot), pilot, FakeOperator(clock, *WISHES), LIMITS, clock, said.append)
    outcome = runner.run(brake=BRAKE)
    assert outcome.fault is None and robot.sent == []
    assert [what for _, what in runner.events] == ["stand", "policy", "damping"]
    assert len(pilot.seconds) - before == 8


def test_without_a_robot_there_is_one_line_and_no_command(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    robot.change = lambda now, state: None
    with pytest.raises(WorkError, match="no state of the robot came for 10 s"):
        started(robot, pilot, clock, said).run(brake=BRAKE)
    assert robot.sent == []


def test_ctrl_c_ends_the_wait_for_a_robot(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    robot.change = lambda now, state: None
    operator = FakeOperator(clock)
    operator.interrupted = True
    begin = clock.now()
    with pytest.raises(WorkError, match="interrupted while waiting"):
        Runner(robot, pilot, operator, LIMITS, clock, said.append).run()
    assert robot.sent == [] and clock.now() - begin < 0.1


def test_a_robot_that_somebody_else_commands_is_left_alone(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    """A Go2 that stands in its sport mode would fall if damping came in between."""
    robot.others = 1
    with pytest.raises(WorkError, match="nothing was sent: another program commands the robot"):
        started(robot, pilot, clock, said).run(brake=BRAKE)
    assert robot.sent == []


def test_a_robot_that_did_not_get_up_does_not_walk(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    lying = np.array([0.0, 1.36, -2.65] * 4)
    robot.change = lambda now, state: dataclasses.replace(state, position=lying)
    runner = started(robot, pilot, clock, said)
    runner.run(brake=BRAKE)
    assert [what for _, what in runner.events] == ["stand", "damping"]


def test_every_tick_is_in_the_log(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str]
) -> None:
    runner = started(robot, pilot, clock, said)
    outcome = runner.run(brake=BRAKE)
    ticks = runner.recorder.ticks()
    assert len(ticks["t"]) == len(robot.sent) == outcome.timing.period.count + 1
    np.testing.assert_allclose(ticks["t"], [t - robot.sent[0][0] for t, _ in robot.sent], atol=1e-9)
    targets = np.array([c.target for _, c in robot.sent])
    logged = np.stack([ticks[f"ctrl/{joint}"] for joint in GO2.joints], axis=1)
    held = np.array([bool(c.stiffness.any()) for _, c in robot.sent])
    np.testing.assert_array_equal(logged[held], targets[held])
    assert np.isnan(logged[~held]).all()
    np.testing.assert_array_equal(np.unique(ticks["stage"]), [0, 1, 2, 3])


def test_a_log_that_breaks_does_not_stop_the_braking(
    robot: FakeRobot, pilot: Rigged, clock: FakeClock, said: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    runner = started(robot, pilot, clock, said)
    kept = runner.recorder.row

    def row(*parts: Any) -> None:  # noqa: ANN401 – of the recorder
        if is_time(robot, clock):
            raise MemoryError
        kept(*parts)

    monkeypatch.setattr(runner.recorder, "row", row)
    outcome = runner.run(brake=BRAKE)
    assert outcome.fault is not None and outcome.fault.name == "internal"
    braking = commands(robot, FAULT_AT + 2 * TICK)
    assert len(braking) > 50 and all(is_damping(c) for c in braking)


class Hanging(io.StringIO):
    """A terminal that takes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.reached, self.go = threading.Event(), threading.Event()

    def write(self, text: str) -> int:
        self.reached.set()
        self.go.wait(timeout=60.0)
        return super().write(text)


def test_a_terminal_that_hangs_does_not_stop_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Hanging()
    monkeypatch.setattr(sys, "stderr", terminal)
    say = teller()
    for line in ("one", "two", "three"):
        say(line)  # would wait for ever, if it printed here
    assert terminal.reached.wait(timeout=60.0) and terminal.getvalue() == ""
    terminal.go.set()
