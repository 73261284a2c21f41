"""Feet that stand keep standing when what a robot observes of itself is overwritten."""

from __future__ import annotations

import numpy as np
import pytest

from tests.worlds.walking.test_world import world
from wt.worlds.stance import HEADING, HEIGHT, LOADED, VELOCITY, FootKinematics
from wt.worlds.walking.world import WalkingWorld

Array = np.ndarray


@pytest.fixture(scope="module", params=["go2_flat", "g1_flat"])
def walked(request: pytest.FixtureRequest) -> tuple[WalkingWorld, FootKinematics, Array, Array]:
    """A world, its feet, and states of S with their hidden variables."""
    w = world(request.param)
    data = w.collect("sim", 400, seed=3)
    s, hidden = data.s_next[:-1], data.hidden[1:]
    inside = data.episode[1:] == data.episode[:-1]
    return w, w._state["sim"].feet, s[inside], hidden[inside].astype(float)


def heights(feet: FootKinematics, s: Array, hidden: Array) -> Array:
    place, _ = feet.motion(s, hidden[:, HEADING])
    return np.asarray(place[:, :, 2] + hidden[:, [HEIGHT]])


def speeds(feet: FootKinematics, s: Array, hidden: Array) -> Array:
    """Of the feet in the world, along the trunk's axes."""
    _, velocity = feet.motion(s, hidden[:, HEADING])
    return np.asarray(velocity + hidden[:, None, VELOCITY])


def test_nothing_moves_where_nothing_is_overwritten(
    walked: tuple[WalkingWorld, FootKinematics, Array, Array],
) -> None:
    w, _, s, hidden = walked
    np.testing.assert_array_equal(w.stance(s, s, hidden), hidden)


def test_standing_feet_keep_height_and_velocity(
    walked: tuple[WalkingWorld, FootKinematics, Array, Array],
) -> None:
    """On average over those that stand, whatever the joints are said to be."""
    w, feet, s, hidden = walked
    rng = np.random.default_rng(0)
    target = (s + rng.normal(size=s.shape) * s.std(axis=0) * 0.05).astype(np.float32)
    target[:, 3:6] /= np.linalg.norm(target[:, 3:6], axis=1, keepdims=True)
    above = heights(feet, s, hidden) - w._robot.foot_rest
    near = np.exp(-np.maximum(above, 0.0) / LOADED)
    kept = w.stance(s, target, hidden)
    stands = above.min(axis=1) < 1e-4
    assert stands.mean() > 0.3
    share = (near / near.sum(axis=1, keepdims=True))[stands]
    for measure in (heights, speeds):
        was, moved, stays = (
            np.einsum("nf,nf...->n...", share, measure(feet, x, h)[stands])
            for x, h in ((s, hidden), (target, hidden), (target, kept))
        )
        assert np.abs(stays - was).mean() < 0.1 * np.abs(moved - was).mean()
    others = np.ones(hidden.shape[1], bool)
    others[[2, 4, 5, 6]] = False
    np.testing.assert_array_equal(kept[:, others], hidden[:, others])


def test_in_the_air_nothing_moves(
    walked: tuple[WalkingWorld, FootKinematics, Array, Array],
) -> None:
    w, _, s, hidden = walked
    above = hidden.copy()
    above[:, HEIGHT] += 1.0
    np.testing.assert_allclose(w.stance(s, s + np.float32(0.01), above), above, atol=1e-9)


def test_where_nothing_is_known_the_lowest_foot_is_at_rest_on_the_ground(
    walked: tuple[WalkingWorld, FootKinematics, Array, Array],
) -> None:
    w, feet, s, hidden = walked
    believed = feet.standing(s, np.zeros_like(hidden))
    lowest = heights(feet, s, believed).argmin(axis=1)
    rows = np.arange(len(s))
    assert np.ptp(heights(feet, s, believed)[rows, lowest]) < 1e-9
    np.testing.assert_allclose(speeds(feet, s, believed)[rows, lowest], 0.0, atol=1e-9)
    np.testing.assert_array_equal(w._state["sim"].nominal(s)[:, VELOCITY], believed[:, VELOCITY])
