"""Bounded least squares from products, against scipy on the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from wt.diagnose.likelihood.adapt import Adaptable, Squares
from wt.diagnose.likelihood.bounded import NormalEquations
from wt.physics.effect import effects

SAMPLES, JOINTS, TOLERANCES, FREE = 200, 3, 4, 2


@pytest.fixture(params=[(slice(None),), (slice(0, 80), slice(80, SAMPLES))], ids=["one", "two"])
def made(request: pytest.FixtureRequest) -> tuple[Adaptable, np.ndarray, np.ndarray]:
    """What tolerances change, an error, and what two parameters change in it; in parts."""
    rng = np.random.default_rng(3)
    changes = rng.standard_normal((JOINTS, SAMPLES, TOLERANCES))
    changes[0, :, 2] = changes[2, :, 3] = 0.0  # most act on some joints only
    error = 5.0 * rng.standard_normal((SAMPLES, JOINTS))
    jacobian = rng.standard_normal((SAMPLES, JOINTS, FREE))
    return Adaptable(changes, np.zeros(TOLERANCES), request.param), error, jacobian


def sums(around: Adaptable, squares: np.ndarray) -> np.ndarray:
    """Part by part, joint by joint."""
    return np.concatenate([squares[part].sum(axis=0) for part in around.parts])


def test_it_knows_what_is_left(made: tuple[Adaptable, np.ndarray, np.ndarray]) -> None:
    around, error, _ = made
    x = np.array([0.3, -2.0, 0.0, 1.0])
    left = sums(around, (error + around.moved(x)) ** 2)
    (squares,) = around.squares(error[None])
    np.testing.assert_allclose(squares.left(x), left, rtol=1e-10)
    np.testing.assert_allclose(around.moved(x), around.columns @ x)
    some = np.array([0, 3])
    left = sums(around, (error + around.columns[:, :, some] @ x[some]) ** 2)
    np.testing.assert_allclose(squares.only(some).left(x[some]), left, rtol=1e-10)


def test_a_step_is_that_of_the_samples(made: tuple[Adaptable, np.ndarray, np.ndarray]) -> None:
    """Parameters come first and pay nothing, tolerances pay for every deviation."""
    around, error, jacobian = made
    weight = np.array([1.0, 0.1, 4.0, 0.5, 2.0, 0.2])[: JOINTS * len(around.parts)]
    each = np.concatenate(
        [
            np.broadcast_to(w, error[part].shape)
            for w, part in zip(weight.reshape(-1, JOINTS), around.parts, strict=True)
        ]
    )
    prior = np.array([0.0] * FREE + [1.0] * TOLERANCES)
    high = np.array([0.05, 9.0, 9.0, 0.02, 9.0, 9.0])
    rows = np.concatenate([jacobian, around.columns], axis=2) * np.sqrt(each)[:, :, None]
    stacked = np.vstack([rows.reshape(-1, FREE + TOLERANCES), np.diag(np.sqrt(prior))])
    target = np.concatenate([-(error * np.sqrt(each)).ravel(), np.zeros(FREE + TOLERANCES)])
    best = lsq_linear(stacked, target, (-high, high), method="bvls").x
    found = around.squares_beside(error, jacobian).step(weight, -high, high, prior)
    np.testing.assert_allclose(found, best, rtol=1e-5, atol=1e-8)
    assert np.abs(best[[0, 3]]) == pytest.approx(high[[0, 3]]), "bounds have to matter"


def test_what_data_do_not_tell_stays_where_it_is_held() -> None:
    """Free it goes where noise leads it, held it does not; what data tell moves the same."""
    rng = np.random.default_rng(3)
    changes = rng.standard_normal((500, 2)) * [1.0, 1e-4]
    error = 2.0 * changes[:, 0] + 0.1 * rng.standard_normal(500)
    products = changes.T @ changes, changes.T @ error, error @ error
    squares, ends = Squares(*(np.array([x]) for x in products)), np.array([5.0, 5.0])
    free, held = (
        squares.step(np.array([100.0]), -ends, ends, np.full(2, 1.0 / hold**2))
        for hold in (np.inf, 0.1)
    )
    assert abs(free[1]) > 1.0
    assert abs(held[1]) < 0.05
    np.testing.assert_allclose(held[0], free[0], rtol=0.01)


@pytest.mark.parametrize("name", ["body.payload_fixed", "body.payload_moving"])
def test_positions_of_loads_are_held(name: str) -> None:
    """Along a body's only axis nothing tells where a load sits."""
    (position,) = [p for p in effects()[name].parameters if p.name == "position"]
    assert position.prior_std < 1.0


def test_a_column_that_is_nothing_and_has_no_room_stays_nothing() -> None:
    """Whichever solver: a load's first moments, where only its mass is asked for."""
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((50, 6)) * [1.0, 0.0, 3.0, 0.0, 2.0, 5.0]
    columns[:, 4] += columns[:, 2]
    target = rng.standard_normal(50)
    normal = NormalEquations(columns.T @ columns, columns.T @ target, 1e-9)
    low = np.array([0.0, 0.0, -np.inf, 0.0, -0.1, -0.1])
    high = np.array([np.inf, 0.0, np.inf, 0.0, 0.1, 0.1])
    seen = [0, 2, 4, 5]
    best = lsq_linear(columns[:, seen], target, (low[seen], high[seen])).x
    for x in (normal.pivoted(low, high), normal.active_set(low, high)):
        assert x[1] == x[3] == 0.0
        np.testing.assert_allclose(x[seen], best, rtol=1e-4, atol=1e-9)
