"""Estimates as they are stated."""

from __future__ import annotations

import numpy as np
import pytest

from wt.diagnose.likelihood.named import named
from wt.diagnose.result import Estimate
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.units import HINGE
from wt.types import Location

TILT = effects()["world.gravity"]


def direction(value: float, half: float) -> Estimate:
    """What is said of a direction whose interval the bounds may have cut."""
    theta, spread = np.array([0.07, value]), np.array([0.01, half])
    lower, upper = TILT.bounds()
    low, high = np.maximum(theta - spread, lower), np.minimum(theta + spread, upper)
    tilted = Planted(TILT, Location("world", "world"), theta)
    assert tilted.at_limit() is None
    return named(tilted, HINGE, low, high, TILT.steps(), np.eye(2))["direction"]


@pytest.mark.parametrize("turns", [-2.0, 0.0, 2.0])
def test_an_angle_that_comes_round_has_no_bounds(turns: float) -> None:
    found = direction(turns * np.pi, 0.2)
    assert found.value == pytest.approx(0.0, abs=1e-12)
    assert found.ci95 == pytest.approx((-0.2, 0.2))
    assert not found.warning


def test_an_angle_that_may_be_any_is_said_to() -> None:
    found = direction(6.0, 5.0)
    assert found.ci95 == pytest.approx((6.0 - 3.0 * np.pi, 6.0 - np.pi))
    assert "any angle" in found.warning


def test_it_is_said_from_minus_180_to_180_degrees() -> None:
    at = Location("world", "world")
    for angle, said in ((2.0 * np.pi - 1e-9, "0°"), (1.5 * np.pi, "-90°"), (0.7, "40.1°")):
        assert f"towards {said} " in TILT.statement(at, np.array([0.07, angle]))
