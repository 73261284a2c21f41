from __future__ import annotations

import numpy as np
import pytest

from tests.worlds.walking.test_world import world
from wt.worlds.closed_loop import ClosedLoop, ReferenceRollouts
from wt.worlds.walking.world import WalkingWorld


@pytest.fixture(scope="module", params=["go2_payload", "g1_uneven"])
def rolled(request: pytest.FixtureRequest) -> tuple[WalkingWorld, ReferenceRollouts]:
    w = world(request.param)
    return w, w.truth(6, 4, 10, seed=1)


def test_r_goes_on_from_its_own_states(rolled: tuple[WalkingWorld, ReferenceRollouts]) -> None:
    """One step of R from what was recorded leads to what was recorded next."""
    w, truth = rolled
    assert isinstance(w, ClosedLoop)
    n = w.spec.n_state
    for k in (0, 7):
        s, hidden = w.advance("real", truth.o[:, k], truth.a[:, k], truth.hidden[:, k])
        # single precision of the stored state, through stiff contacts
        assert np.median(np.abs(s - truth.o[:, k + 1, :n])) < 1e-4
        assert np.median(np.abs(hidden - truth.hidden[:, k + 1])) < 1e-4
        assert np.array_equal(truth.o[:, k + 1, n:], truth.a[:, k])


def test_the_policy_acts_on_observations_and_context_alone(
    rolled: tuple[WalkingWorld, ReferenceRollouts],
) -> None:
    w, truth = rolled
    for k in (0, 5):
        acted = w.act(truth.o[:, k], truth.context[:, k])
        assert np.allclose(acted, truth.a[:, k], atol=2e-4)


def test_nobody_is_astray_who_walks_and_everybody_who_cannot_be_there(
    rolled: tuple[WalkingWorld, ReferenceRollouts],
) -> None:
    w, truth = rolled
    s, hidden = truth.o[:, 4, : w.spec.n_state], truth.hidden[:, 4]
    assert not w.astray(s, hidden).any()
    sunk, fast = hidden.copy(), hidden.copy()
    sunk[:, 2] -= 0.6
    fast[:, 4] += 9.0
    upside_down, lost = s.copy(), s.copy()
    upside_down[:, 3:6] *= -1
    lost[:, 8] = np.nan
    for state, h in ((s, sunk), (s, fast), (upside_down, hidden), (lost, hidden)):
        assert w.astray(state, h).all()


def test_same_seed_same_truth() -> None:
    w = world("go2_flat")
    first, again, other = (w.truth(3, 1, 3, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.o, again.o)
    assert not np.array_equal(first.o, other.o)
