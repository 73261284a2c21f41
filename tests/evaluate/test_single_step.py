"""Errors against numbers worked out by hand, on channels of very different size."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.evaluate.single_step import ErrorScales, errors, first_episode, poses
from wt.types import Channel, Pairs, Transitions, TransitionSpec

SPEC = TransitionSpec(
    task="toy",
    rate_hz=50.0,
    joints=("elbow", "hip"),
    observation=(
        Channel("qpos/hip", "rad"), Channel("qpos/elbow", "rad"), Channel("last_action/hip", "rad")
    ),
    n_state=2,
    action=(Channel("ctrl/hip", "rad"),),
    pose=(1, 0),
)  # fmt: skip


def transitions(
    before: np.ndarray,
    after: np.ndarray,
    episode: np.ndarray | None = None,
    step: np.ndarray | None = None,
) -> Transitions:
    n = len(after)
    return Transitions(
        o=np.hstack([before, np.full((n, 1), 9.0)]),
        a=np.zeros((n, 1)),
        s_next=after,
        nominal=after,
        hidden=np.empty((n, 0)),
        episode=np.zeros(n) if episode is None else episode,
        step=np.arange(n) if step is None else step,
    )


def test_errors_are_in_units_of_rs_spread_and_in_physical_ones() -> None:
    # next states spread by 1 and 100, changes by 0.5 and 20; population deviations
    after = np.array([[-1.0, -100.0], [1.0, 100.0]])
    before = after - np.array([[-0.5, -20.0], [0.5, 20.0]])
    scales = ErrorScales.of(transitions(before, after), SPEC)
    np.testing.assert_allclose(scales.state, [1.0, 100.0], rtol=1e-6)
    np.testing.assert_allclose(scales.change, [0.5, 20.0], rtol=1e-6)

    truth = np.array([[0.0, 0.0], [2.0, 50.0]])
    pairs = Pairs(transitions(truth, truth), truth)
    wrong = np.array([[0.1, 0.0], [0.3, 20.0]])
    found = errors((truth + wrong).astype(np.float32), pairs, scales)
    # ((0.1² + 0.3²)/1² + 20²/100²) / 4 and ((0.1² + 0.3²)/0.5² + 20²/20²) / 4
    assert found.mse == pytest.approx((0.10 + 0.04) / 4, rel=1e-5)
    assert found.mse_change == pytest.approx((0.40 + 1.00) / 4, rel=1e-5)
    np.testing.assert_allclose(found.rmse, [np.sqrt(0.05), np.sqrt(200.0)], rtol=1e-5)


def test_an_exact_prediction_has_no_error() -> None:
    truth = np.array([[0.25, 1.0], [0.5, -1.0]])
    data = transitions(truth - [[0.0, 0.5], [0.25, 0.25]], truth)
    found = errors(data.s_next, Pairs(data, truth), ErrorScales.of(data, SPEC))
    assert (found.mse, found.mse_change, found.rmse.tolist()) == (0.0, 0.0, [0.0, 0.0])


@pytest.mark.parametrize(
    ("episode", "step", "longest", "length"),
    [
        ([0, 0, 0, 0], [0, 1, 2, 3], 10, 4),  # all of it
        ([0, 0, 0, 0], [0, 1, 2, 3], 3, 3),  # as much as is asked for
        ([4, 4, 5, 5], [7, 8, 0, 1], 10, 2),  # another episode begins
        ([0, 0, 0, 0], [0, 1, 5, 6], 10, 2),  # a gap
        ([1, 2, 3, 4], [0, 0, 0, 0], 10, 1),
    ],
)
def test_first_episode_is_unbroken(
    episode: list[int], step: list[int], longest: int, length: int
) -> None:
    zeros = np.zeros((4, 2))
    pairs = Pairs(transitions(zeros, zeros, np.array(episode), np.array(step)), zeros)
    assert first_episode(pairs, longest).tolist() == list(range(length))


def test_poses_find_each_joint_by_name_and_leave_others_at_rest() -> None:
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody>
          <body><joint name="hip"/><geom size="1"/>
            <body><joint name="jaw" type="slide" ref="0.7"/><geom size="1"/>
              <body><joint name="elbow"/><geom size="1"/></body></body></body>
        </worldbody></mujoco>""")
    states = np.array([[0.1, 0.2], [0.3, 0.4]], np.float32)
    expected = [[0.1, 0.7, 0.2], [0.3, 0.7, 0.4]]
    np.testing.assert_allclose(poses(model, SPEC, states), expected, rtol=1e-6)
