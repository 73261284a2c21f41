"""A policy on a robot sees what it saw in training, and its actions mean the same."""

from __future__ import annotations

import numpy as np
import pytest

from deploy.pilot import Pilot, gravity
from deploy.remote import Remote
from deploy.robot import State
from wt.errors import WorkError
from wt.worlds.legged import FLAT, TIMESTEP, Herd, Start
from wt.worlds.policy import Policy
from wt.worlds.robots import GO2

COMMAND = np.array([0.4, -0.2, 0.3])


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load("go2", GO2)


def state_of(herd: Herd) -> State:
    """What the first robot of a herd would report."""
    return State(
        time=0.0, position=herd.joint_pos[0].copy(), velocity=herd.joint_vel[0].copy(),
        torque=np.zeros(12), quaternion=herd.qpos[0, 3:7].copy(), gyro=herd.qvel[0, 3:6].copy(),
        temperature=np.zeros(12), battery=100.0, remote=Remote(),
    )  # fmt: skip


def test_observations_and_targets_are_those_of_training(policy: Policy) -> None:
    """Step by step beside the simulation in which policies are trained and evaluated."""
    model = GO2.describe(GO2.physics, TIMESTEP, FLAT).compile()
    herd = Herd(GO2, model, 1, threads=1)
    herd.reset(np.arange(1), np.random.default_rng(0), Start(joints=0.1, speed=0.3))
    pilot, clock = Pilot(policy), policy.clock(1)
    for _ in range(50):
        seen = herd.observe()
        pilot.ask(state_of(herd), COMMAND)
        action = pilot.answer(wait=60.0)
        assert action is not None
        np.testing.assert_allclose(pilot.observe(state_of(herd)), seen[0], atol=1e-5)
        expected = policy.act(seen, COMMAND[None], clock.read(herd.time, COMMAND[None]))
        np.testing.assert_allclose(action, expected[0], atol=1e-4)
        np.testing.assert_allclose(pilot.targets(action), GO2.targets(action[None])[0], atol=1e-6)
        herd.step(action[None])
    assert not herd.fallen().any()


def test_commands_stay_within_those_of_training(policy: Policy) -> None:
    model = GO2.describe(GO2.physics, TIMESTEP, FLAT).compile()
    state = state_of(Herd(GO2, model, 1, threads=1))
    answers = []
    for command in (np.array([99.0, -99.0, 99.0]), np.array([1.0, -0.5, 1.0])):
        pilot = Pilot(policy)
        pilot.ask(state, command)
        answers.append(pilot.answer(wait=60.0))
    np.testing.assert_array_equal(*answers)


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next(policy: Policy) -> None:
    model = GO2.describe(GO2.physics, TIMESTEP, FLAT).compile()
    state = state_of(Herd(GO2, model, 1, threads=1))
    pilot, other = Pilot(policy), Pilot(policy)
    for asked in (np.zeros(3), COMMAND):
        pilot.ask(state, asked)  # nobody takes the first
    other.ask(state, COMMAND)
    np.testing.assert_array_equal(pilot.answer(wait=60.0), other.answer(wait=60.0))
    assert pilot.answer(wait=0.0) is None


def test_a_policy_that_fails_is_heard_of(policy: Policy, monkeypatch: pytest.MonkeyPatch) -> None:
    model = GO2.describe(GO2.physics, TIMESTEP, FLAT).compile()
    pilot = Pilot(policy)

    def fail(*_: object) -> None:
        raise RuntimeError("out of memory")

    monkeypatch.setattr(policy, "act", fail)
    pilot.ask(state_of(Herd(GO2, model, 1, threads=1)), COMMAND)
    with pytest.raises(WorkError, match=r"the policy failed \(out of memory\)"):
        pilot.answer(wait=60.0)


def test_gravity_points_down() -> None:
    half = np.sqrt(0.5)
    np.testing.assert_allclose(gravity(np.array([1.0, 0, 0, 0])), [0, 0, -1])
    # pitched by 90° nose down: the world's down is the trunk's forward
    np.testing.assert_allclose(gravity(np.array([half, 0, half, 0])), [1, 0, 0], atol=1e-12)
    # rolled by 90° to the right: down is the trunk's right
    np.testing.assert_allclose(gravity(np.array([half, half, 0, 0])), [0, -1, 0], atol=1e-12)
