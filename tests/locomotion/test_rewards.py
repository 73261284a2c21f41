"""Terms of the reward against values worked out by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from wt.errors import ConfigError
from wt.locomotion import rewards
from wt.locomotion.config import Rewards
from wt.locomotion.rewards import TERMS, WANTED, RewardSum, Step

F32 = np.float32


def step(**changes: object) -> Step:
    """Two robots of three joints and two feet that stand still, as changed."""
    zeros = {
        "command": (2, 3), "velocity": (2, 4), "gyro": (2, 3), "gravity": (2, 3), "height": (2,),
        "pose": (2, 3), "excess": (2, 3), "joint_vel": (2, 3), "joint_acc": (2, 3),
        "others": (2,), "torque": (2, 3), "action": (2, 3), "last_action": (2, 3), "force": (2, 2),
        "clearance": (2, 2), "foot_speed": (2, 2), "air": (2, 2), "stance": (2, 2),
        "swing": (2, 2),
    }  # fmt: skip
    fields: dict[str, object] = {name: np.zeros(shape, F32) for name, shape in zeros.items()}
    fields |= {"contact": np.ones((2, 2), bool), "landed": np.zeros((2, 2), bool), "dt": 0.02}
    changes["moving"] = np.abs(np.array(changes.get("command", fields["command"]))).max(1) > 0
    for name, value in changes.items():
        kind = bool if name in ("contact", "landed", "moving") else F32
        fields[name] = np.array(value, kind)
    return Step(**fields)  # type: ignore[arg-type]


R = Rewards()
GO = [[0.5, 0, 0], [0, 0, 0]]  # the first robot is to walk, the second to stand
UP = [[True, False], [True, True]]  # the first one's right foot is up


@pytest.mark.parametrize(
    ("term", "changes", "expected"),
    [
        ("vertical", {"velocity": [[9, 9, 9, 0.5], [0, 0, 0, -1]]}, [0.25, 1]),
        ("rolling", {"gyro": [[1, 2, 9], [0, 0, 9]]}, [5, 0]),
        ("tilt", {"gravity": [[0.6, 0, -0.8], [0, 0, -1]]}, [0.36, 0]),
        ("height", {"height": [-0.2, 0.1]}, [4, 1]),
        ("torque", {"torque": [[1, -2, 3], [0, 0, 0]]}, [14, 0]),
        ("power", {"torque": [[1, -2, 3]] * 2, "joint_vel": [[1, 1, -1], [0, 0, 0]]}, [6, 0]),
        ("acceleration", {"joint_acc": [[3, 4, 0], [0, 0, 1]]}, [25, 1]),
        ("action_rate", {"action": [[1, 0, 0]] * 2, "last_action": [[0, 2, 0], [1, 0, 0]]}, [5, 0]),
        ("limits", {"excess": [[0.1, 0.2, 0], [0, 0, 0]]}, [0.3, 0]),
        ("bumps", {"others": [3, 0]}, [3, 0]),
        ("slip", {"contact": UP, "foot_speed": [[2, 5], [1, 1]]}, [4, 2]),
        (
            "clearance",
            {"command": GO, "contact": UP, "clearance": [[9, 0.02], [0, 0]],
             "foot_speed": [[9, 2], [9, 9]]},
            [0.08, 0],
        ),
        (
            "air_time",  # T = 0.3 s: nothing below 0.15 s, at most 0.3 s; spread over 20 ms
            {"command": [[1, 0, 0], [1, 0, 0]], "landed": [[True, True], [True, False]],
             "air": [[0.1, 0.25], [2.0, 0.3]]},
            [5, 15],
        ),
        (
            "single_stance",
            {"command": [[1, 0, 0]] * 2, "contact": UP, "stance": [[0.2, 0], [9, 9]],
             "air": [[0, 0.3], [0, 0]]},
            [0.2, 0],
        ),
        # the first robot's left foot is to stand and its right one to swing; the second rests
        ("rhythm", {"contact": UP, "swing": [[-1, 0.5], [-1, -1]]}, [1, 1]),
        ("rhythm", {"contact": UP[::-1], "swing": [[-1, 0.5], [-1, -1]]}, [0.5, 0.5]),
        (
            "load",  # the weight on the right foot, of which more than all is no worse
            {"swing": [[-1, 0.5], [0.2, -1]], "force": [[9, 0.4], [1.5, 9]]},
            [0.4, 1],
        ),
        (
            "lift",  # h* = 6 cm at half the swing, sin 30° = 1/2 of it at a sixth
            {"swing": [[-1, 0.5], [1 / 6, -1]],
             "clearance": [[9, 0.03], [0.03, 9]]},
            [0.25, 0],
        ),
        ("flight", {"contact": [[False, False]] * 2, "command": GO}, [1, 0]),
        ("flight", {"contact": UP, "command": GO}, [0, 0]),
        ("impact", {"landed": UP, "force": [[2, 9], [1, 1]]}, [100, 100]),
        ("still", {"command": GO[::-1], "contact": UP, "pose": [[0.1, -0.2, 0], [1, 1, 1]]},
         [1.3, 0]),
        ("alive", {}, [1, 1]),
    ],
)  # fmt: skip
def test_term(term: str, changes: dict[str, object], expected: list[float]) -> None:
    value = TERMS[term](step(**changes), R)
    np.testing.assert_allclose(value, expected, rtol=1e-5, atol=1e-9)


def test_tracking_pays_in_full_without_error_and_partly_with_it() -> None:
    r = dataclasses.replace(R, linear_width=0.5, turn_width=0.5, precise=0.25)
    s = step(command=[[0.5, 0, 1.0], [0, 0, 0]], velocity=[[0.5, 0.25, 0.5, 9], [0, 0, 0, 9]])
    # e/σ = 1/2 for the linear error, 1 for the turning one
    linear = 0.75 * np.exp(-0.25) + 0.25 * np.exp(-4)
    turn = 0.75 * np.exp(-1) + 0.25 * np.exp(-16)
    np.testing.assert_allclose(rewards.track_linear(s, r), [linear, 1], rtol=1e-5)
    np.testing.assert_allclose(rewards.track_turn(s, r), [turn, 1], rtol=1e-5)


def test_every_term_has_a_weight_and_every_wanted_one_exists() -> None:
    names = {f.name for f in dataclasses.fields(Rewards)}
    assert set(TERMS) <= names and set(WANTED) <= set(TERMS)


def test_the_sum_is_weighted_with_penalties_negative_and_a_fall_counted_once() -> None:
    nothing = {name: 0.0 for name in TERMS}
    weights = Rewards(**{**nothing, "alive": 2.0, "vertical": 3.0, "fall": 5.0})
    total = RewardSum(weights, ("a", "b", "c"))
    reward, means = total(step(velocity=[[0, 0, 0, 1], [0, 0, 0, 0]]), np.array([False, True]))
    np.testing.assert_allclose(reward, [(2 - 3) * 0.02, 2 * 0.02 - 5], rtol=1e-5)
    assert means == pytest.approx({"alive": 2.0, "vertical": -1.5})


def test_posture_weighs_joints_by_pattern() -> None:
    nothing = {name: 0.0 for name in TERMS}
    weights = Rewards(**{**nothing, "posture": {"hip_*": 1.0, "hip_yaw": 3.0}})
    total = RewardSum(weights, ("hip_roll", "hip_yaw", "knee"))
    reward, _ = total(step(pose=[[1, 0, 0], [0, 2, 5]]), np.zeros(2, bool))
    np.testing.assert_allclose(reward, [-0.02, -0.24], rtol=1e-5)


def test_a_pattern_that_fits_no_joint_is_refused() -> None:
    with pytest.raises(ConfigError, match="'hipp' fits no joint: did you mean 'hip'"):
        RewardSum(Rewards(posture={"hipp": 1.0}), ("hip", "knee"))
