"""Least squares in which the model's tolerances stay inside their box."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from wt.diagnose.likelihood.bounded import NormalEquations

RIDGE = 1e-7


@pytest.mark.parametrize("seed", range(40))
def test_bounded_least_squares_is_the_best_there_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 24
    mixed = np.eye(n) + rng.normal(size=(n, n)) * rng.uniform(0.0, 2.0)
    design = rng.normal(size=(90, n)) @ mixed
    # a hypothesis that looks like a tolerance, as a wrong mass does
    design[:, 0] = 3.0 * design[:, 7] + 1e-3 * rng.normal(size=90)
    target = 3.0 * design @ rng.normal(size=n) + rng.normal(size=90)
    high = rng.uniform(0.1, 3.0, n)
    high[:3] = np.inf
    found = NormalEquations(design.T @ design, design.T @ target, RIDGE).pivoted(-high, high)
    best = lsq_linear(design, target, (-high, high), method="bvls").x

    def error(x: np.ndarray) -> float:
        return float(np.sum((design @ x - target) ** 2))

    assert (np.abs(found) <= high * (1.0 + 1e-12)).all()
    assert error(found) <= 1.001 * error(best) + 1e-6


def test_a_tolerance_explains_no_more_than_its_box() -> None:
    design = np.ones((10, 2))  # hypothesis and tolerance alike
    target = np.full(10, 5.0)
    low, high = np.array([-np.inf, -1.0]), np.array([np.inf, 1.0])
    hypothesis, tolerance = NormalEquations(design.T @ design, design.T @ target, RIDGE).pivoted(
        low, high
    )
    assert abs(tolerance) <= 1.0
    assert hypothesis + tolerance == pytest.approx(5.0, rel=1e-5)


@pytest.mark.parametrize("seed", range(10))
def test_where_it_begins_changes_nothing_but_the_number_of_pivots(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    design, target = rng.normal(size=(90, 24)), 6.0 * rng.normal(size=90)
    high = rng.uniform(0.02, 0.6, 24)
    high[:3], high[3:6] = np.inf, 0.0  # without bounds, and without room
    normal = NormalEquations(design.T @ design, design.T @ target, RIDGE)
    pivots, solve = [0], np.linalg.solve

    def counted(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        pivots[0] += 1
        return solve(a, b)

    monkeypatch.setattr(np.linalg, "solve", counted)
    plain = normal.pivoted(-high, high)
    from_nothing, pivots[0] = pivots[0], 0
    again = normal.pivoted(-high, high, (1.0 - 1e-5) * plain)  # as reflections leave bounds
    np.testing.assert_allclose(again, plain, atol=1e-9)
    assert not again[3:6].any()
    assert pivots[0] <= 2 < from_nothing
