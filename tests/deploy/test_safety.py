"""Watchdogs see what they are for and nothing else; limits let through what is harmless."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from deploy import go2, safety
from deploy.robot import Command, State
from deploy.safety import Limits
from tests.deploy.conftest import at_joint, standing
from wt.errors import ConfigError
from wt.worlds.robots import GO2

LIMITS = Limits()
DRIVES = go2.drives(GO2.joints)
CALF = GO2.joints.index("FL_calf_joint")
FINE = standing(10.0)


def pitched(angle: float) -> np.ndarray:
    return np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])


def named(state: State, before: State | None = None) -> list[str]:
    return [name for name, _ in safety.faults(state, before, DRIVES, LIMITS)]


def test_nothing_is_wrong_with_a_robot_that_stands() -> None:
    assert named(FINE) == []
    assert named(FINE, standing(10.0 - 0.002)) == []


@pytest.mark.parametrize(
    ("name", "wrong", "nearly"),
    [
        ("tilt", {"quaternion": pitched(1.01)}, {"quaternion": pitched(-0.99)}),
        ("tilt", {"quaternion": np.array([0.0, 1.0, 0.0, 0.0])}, {"quaternion": -pitched(0.9)}),
        (
            "range",
            {"position": at_joint(FINE.position, CALF, -0.83776 + 0.16)},
            {"position": at_joint(FINE.position, CALF, -2.7227 - 0.14)},
        ),
        (
            "speed",
            {"velocity": at_joint(FINE.velocity, CALF, -15.7 * 1.26)},
            {"velocity": at_joint(FINE.velocity, CALF, 15.7 * 1.24)},
        ),
        (
            "temperature",
            {"temperature": at_joint(FINE.temperature, CALF, 81.0)},
            {"temperature": at_joint(FINE.temperature, CALF, 80.0)},
        ),
        ("battery", {"battery": 9.0}, {"battery": 10.0}),
        (
            "not_finite",
            {"gyro": np.array([0.0, math.inf, 0.0])},
            {"torque": np.full(12, math.nan)},  # an estimate, on which nothing is decided
        ),
        ("not_finite", {"quaternion": np.full(4, math.nan)}, {}),
    ],
)
def test_a_state_is_wrong_beyond_its_limit_and_not_before(
    name: str, wrong: dict[str, object], nearly: dict[str, object]
) -> None:
    assert named(dataclasses.replace(FINE, **wrong)) == [name]  # type: ignore[arg-type]
    assert named(dataclasses.replace(FINE, **nearly)) == []  # type: ignore[arg-type]


def test_a_joint_whose_sign_flips_has_jumped() -> None:
    """Also one whose flipped position is within its range; a fast one has not."""
    thigh = GO2.joints.index("FL_thigh_joint")
    flipped = at_joint(FINE.position, thigh, -FINE.position[thigh])
    assert named(dataclasses.replace(FINE, position=flipped), standing(9.998)) == ["jump"]
    fast = at_joint(FINE.position, thigh, FINE.position[thigh] + 0.002 * 30.1)
    assert named(dataclasses.replace(FINE, position=fast), standing(9.998)) == []
    # after 40 ms without a state it may be anywhere that its speed allows
    far = at_joint(FINE.position, thigh, FINE.position[thigh] + 0.04 * 30.1)
    assert named(dataclasses.replace(FINE, position=far), standing(9.96)) == []


@pytest.mark.parametrize(
    ("watchdog", "bad", "good"),
    [
        (safety.stale, (0.031, 0.03), (0.03, 0.03)),
        (safety.stale, (math.inf, 0.03), (0.0, 0.03)),
        (safety.overdue, (0.011, 0.01), (0.01, 0.01)),
        (safety.intruded, (1,), (0,)),
        (safety.bad_action, (np.zeros(11), 12), (np.zeros(12), 12)),
        (safety.bad_action, (np.zeros((1, 12)), 12), (np.full(12, -99.0), 12)),
        (safety.bad_action, (at_joint(np.zeros(12), 7, math.nan), 12), (np.zeros(12), 12)),
    ],
)
def test_a_watchdog_has_words_for_what_is_wrong(
    watchdog: Callable[..., str | None], bad: tuple[object, ...], good: tuple[object, ...]
) -> None:
    assert watchdog(*bad)
    assert watchdog(*good) is None


def test_words_name_the_culprit() -> None:
    words = safety.bad_action(at_joint(np.zeros(12), 7, math.nan), 12)
    assert words == "the policy's output number 7 is no number"
    words = safety.hot(at_joint(np.zeros(12), 3, 95.0), 80.0)
    assert words == "motor 3 is at 95 °C, 80 is the most"


def test_targets_stay_inside_the_range_and_slew() -> None:
    target = safety.within_range(np.full(12, 9.0), DRIVES, 0.02)
    np.testing.assert_allclose(target, DRIVES.high - 0.02)
    np.testing.assert_array_equal(safety.within_range(FINE.position, DRIVES, 0.02), FINE.position)
    np.testing.assert_allclose(safety.slewed(np.full(3, 9.0), np.zeros(3), 0.1), 0.1)
    np.testing.assert_allclose(safety.slewed(np.full(3, -0.05), np.zeros(3), 0.1), -0.05)


def test_gains_ask_for_no_more_torque_than_there_is() -> None:
    """Torque computed from the drives' law, not from the code's."""
    rng = np.random.default_rng(0)
    stiffness, damping = np.full(12, 50.0), np.full(12, 3.5)
    for _ in range(50):
        q, dq = rng.normal(size=12), 5 * rng.normal(size=12)
        state = dataclasses.replace(FINE, position=q, velocity=dq)
        wanted = Command(q + rng.normal(size=12), stiffness, damping)
        target = safety.within_torque(wanted, state, DRIVES.torque)
        asked = stiffness * (wanted.target - q) - damping * dq
        given = stiffness * (target - q) - damping * dq
        np.testing.assert_allclose(given, np.clip(asked, -DRIVES.torque, DRIVES.torque))
    limp = Command(np.full(12, 3.0), np.zeros(12), damping)
    np.testing.assert_array_equal(safety.within_torque(limp, state, DRIVES.torque), limp.target)


def test_limits_are_changed_by_words() -> None:
    assert Limits.parse(["tilt=0.5", "slew=10"]) == Limits(tilt=0.5, slew=10.0)
    for word, said in (
        ("tild=1", "did you mean 'tilt'"),
        ("tilt", "a number is needed"),
        ("tilt=0", "above zero"),
        ("tilt=nan", "above zero"),
    ):
        with pytest.raises(ConfigError, match=said):
            Limits.parse([word])
