"""Initial states adapt as far as they are known, and no farther."""

from __future__ import annotations

import numpy as np
import pytest

from wt.diagnose.likelihood.adapt import (
    FARTHEST,
    Adaptable,
    InitialState,
    initial_states,
    project,
    project_changes,
)

RESPONSE = np.random.default_rng(0).standard_normal((200, 1, 2))
MSE = np.array([0.01])


def state(farthest: float = FARTHEST) -> InitialState:
    (made,) = initial_states([slice(0, 200)], RESPONSE, MSE, farthest)
    return made


def error(*shift: float) -> np.ndarray:
    return RESPONSE @ np.array(shift)


def test_what_is_plausible_is_taken_out_of_an_error() -> None:
    left = project(error(1.0, -2.0), [state()])
    assert np.abs(left).max() < 1e-3


@pytest.mark.parametrize(("farthest", "found"), [(FARTHEST, FARTHEST), (np.inf, 30.0)])
def test_a_window_that_wants_more_keeps_its_error(farthest: float, found: float) -> None:
    shift = state(farthest).shift(error(30.0, 1.0).ravel())
    assert shift[0] == pytest.approx(found, rel=1e-3)
    left = project(error(30.0, 1.0), [state(farthest)])
    assert (np.sqrt(np.mean(left**2)) > 20.0) == (farthest == FARTHEST)


def test_what_is_not_held_makes_up_for_what_is_as_well_as_it_may() -> None:
    made, wanted = state(), error(4.0, 1.0).ravel()
    held = made.shift(wanted)
    tried = [np.array([FARTHEST, second]) for second in np.linspace(-3.0, 3.0, 601)]

    def cost(shift: np.ndarray) -> float:
        left = wanted - made.response @ shift
        return float(left @ left / MSE[0] + shift @ shift)

    assert held[1] == pytest.approx(min(tried, key=cost)[1], abs=0.01)


@pytest.mark.parametrize("wanted", [error(1.0, -2.0), error(4.0, 1.0), error(20.0, -20.0)])
def test_a_change_is_the_slope_of_the_projection_whatever_is_at_its_limit(
    wanted: np.ndarray,
) -> None:
    change, small = np.random.default_rng(1).standard_normal((200, 1)), 1e-4
    around = Adaptable(np.zeros((1, 200, 0)), np.zeros(0), (slice(None),), (state(),))
    slope = (around.project(wanted + small * change) - around.project(wanted)) / small
    changed = project_changes(wanted, change[:, :, None], around.initial)[:, :, 0]
    np.testing.assert_allclose(changed, slope, atol=1e-6)
