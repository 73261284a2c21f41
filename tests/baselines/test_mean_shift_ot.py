from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.baselines.toy import Trial
from wt.baselines.base import find
from wt.config import Baselines
from wt.train.mean_field import gaussian_transport
from wt.train.selection import Paired, Unpaired


def test_map_between_2d_gaussians_is_the_known_one() -> None:
    # y = T x with T symmetric positive definite is the optimal transport of x to y's Gaussian
    expected = torch.tensor([[2.0, 0.6], [0.6, 0.5]], dtype=torch.float64)
    mixing = torch.tensor([[1.0, 0.0], [-0.8, 1.5]], dtype=torch.float64)
    noise = torch.randn(4000, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    x = noise @ mixing.T
    found = gaussian_transport(x, x @ expected)
    torch.testing.assert_close(found, expected, atol=2e-3, rtol=0.0)


def test_recovers_what_a_fleeting_force_does(fleeting: Trial, small: Baselines) -> None:
    # f is independent of (o, a) here, so mean shift and a linear map are exact; each is needed
    baseline = find("MeanShiftOT")(fleeting.toy.spec, small, 0)
    baseline.train(fleeting.sim, fleeting.real)
    error = fleeting.error(baseline.predict(fleeting.test))
    assert error < 0.1 * fleeting.toy.error_without_history()
    assert error < 0.1 * fleeting.error(fleeting.test.sim_next)


@pytest.mark.parametrize("paired", [False, True])
def test_the_step_is_chosen_that_is_best_on_what_is_held_out(
    paired: bool, fleeting: Trial, small: Baselines
) -> None:
    # so few transitions that they are learned by heart
    few = np.arange(100)
    sim, real = fleeting.sim.select(few), fleeting.real.select(few)
    last, chosen = (find("MeanShiftOT")(fleeting.toy.spec, small, 0) for _ in range(2))
    last.train(sim, real)
    held = Unpaired(fleeting.sim.select(np.arange(1000, 3000)), fleeting.test.real)
    chosen.train(sim, real, Paired(fleeting.test, np.ones(4)) if paired else held)
    errors = [fleeting.error(b.predict(fleeting.test)) for b in (last, chosen)]
    assert errors[1] < errors[0]


def test_the_domains_may_differ_in_size(fleeting: Trial, small: Baselines) -> None:
    baseline = find("MeanShiftOT")(fleeting.toy.spec, small, 0)
    baseline.train(fleeting.sim, fleeting.real.select(np.arange(3000)))
    error = fleeting.error(baseline.predict(fleeting.test))
    assert error < 0.2 * fleeting.toy.error_without_history()
