"""Commands are scaled where a policy does less, or more, than it is told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wt.locomotion.calibrate import calibrate, factors
from wt.locomotion.evaluate import CommandTracking, PolicyEvaluation, WalkFigures
from wt.worlds.policy import CARD, GRAPH, SHIPPED, Policy
from wt.worlds.robots import GO2


def figures(*tried: tuple[str, float, float, float]) -> PolicyEvaluation:
    """Of (axis, command, what was reached, share that fell)."""
    walk = WalkFigures(1, 1.0, 0.0, 1.0, 1.0, 0.5, 0.1, 0.3, 2.0)
    return PolicyEvaluation(
        tuple(CommandTracking(a, c, m, 0.0, 0.0, f) for a, c, m, f in tried), walk
    )


def test_a_policy_that_turns_too_slowly_is_told_more() -> None:
    found = factors(
        figures(
            ("forward", 1.0, 0.99, 0.0), ("forward", -1.0, -0.99, 0.0),
            ("sideways", 0.5, 0.55, 0.0), ("sideways", -0.5, -0.55, 0.0),
            ("turn", 0.5, 0.4, 0.0), ("turn", -0.5, -0.4, 0.0),
        )
    )  # fmt: skip
    np.testing.assert_allclose(found, [1.0, 1.0 / 1.1, 1.25])


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ((0.4, 0.1), (-0.4, 0.0)),  # some fell
        ((0.45, 0.0), (-0.2, 0.0)),  # the one side is not the other
        ((0.2, 0.0), (-0.2, 0.0)),  # far from what it was told
        ((-0.1, 0.0), (0.1, 0.0)),  # the wrong way
    ],
)
def test_what_no_factor_mends_is_left(
    left: tuple[float, float], right: tuple[float, float]
) -> None:
    tried = figures(("turn", 0.5, *left), ("turn", -0.5, *right))
    np.testing.assert_array_equal(factors(tried), np.ones(3))


def test_the_graph_hears_the_scaled_command(tmp_path: Path) -> None:
    for name in (GRAPH, CARD):
        (tmp_path / name).write_bytes((SHIPPED / "go2" / name).read_bytes())
    before = Policy.load(tmp_path, GO2)
    by = np.array([1.0, 0.9, 1.25])
    calibrate(tmp_path, by)
    calibrate(tmp_path, by)
    after = Policy.load(tmp_path, GO2)  # which compares the graph with its card's hash
    rng = np.random.default_rng(0)
    observation, command = rng.normal(size=(6, 42)), rng.normal(size=(6, 3))
    none = np.zeros((6, 0))
    np.testing.assert_allclose(
        after.act(observation, command, none),
        before.act(observation, command * by**2, none),
        atol=1e-4,
    )
    assert not np.allclose(
        after.act(observation, command, none), before.act(observation, command, none), atol=1e-2
    )
    card = json.loads((tmp_path / CARD).read_text())
    assert card["training"]["turn_factor"] == pytest.approx(1.25**2)
