from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch

from wt.nets.mlp import mlp
from wt.train.regression import Regression, regress


def linear_problem() -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(400, 3))
    y = x @ rng.normal(size=(3, 2)) + 0.3 * rng.normal(size=(400, 2))
    return torch.tensor(x, dtype=torch.float32), torch.tensor(y, dtype=torch.float32)


def fitted(settings: Regression, **more: object) -> torch.nn.Module:
    x, y = linear_problem()
    torch.manual_seed(0)
    net = mlp(3, 2, 0, 0)
    regress(net, lambda rows: net(x[rows]) - y[rows], len(x), settings, **more)  # type: ignore[arg-type]
    return net


def test_finds_what_least_squares_finds() -> None:
    x, y = (t.double().numpy() for t in linear_problem())
    net = fitted(Regression(steps=600, batch=256, learning_rate=0.05, weight_decay=0.0))
    expected = np.linalg.lstsq(np.hstack([x, np.ones((len(x), 1))]), y, rcond=None)[0]
    np.testing.assert_allclose(net[0].weight.detach().T, expected[:3], atol=0.02)
    np.testing.assert_allclose(net[0].bias.detach(), expected[3], atol=0.02)


def test_same_seed_same_network() -> None:
    def weight(seed: int) -> torch.Tensor:
        return fitted(Regression(30, 32, 0.05, seed))[0].weight

    assert torch.equal(weight(1), weight(1))
    assert not torch.equal(weight(1), weight(2))


def test_rate_rises_over_a_tenth_and_falls_to_zero() -> None:
    budget = Regression(steps=1000, batch=1, learning_rate=2.0)
    rates = np.array([budget.rate(k) for k in range(1000)])
    assert rates[0] == pytest.approx(0.02, rel=1e-3)
    assert 85 <= rates.argmax() <= 115 and 1.9 < rates.max() <= 2.0
    assert (np.diff(rates[150:]) < 0).all() and rates[-1] < 1e-4


@pytest.mark.parametrize(("steps", "first", "count"), [(250, 2, 125), (30, 1, 30), (1999, 19, 106)])
def test_progress_is_told_of_every_hundredth_and_of_the_last(
    steps: int, first: int, count: int
) -> None:
    told: list[tuple[int, int]] = []
    fitted(Regression(steps, 8, 0.01), progress=lambda done, total: told.append((done, total)))
    assert told[0] == (first, steps) and told[-1] == (steps, steps) and len(told) == count


def test_the_weights_of_the_lowest_score_are_kept() -> None:
    at_look: list[torch.Tensor] = []
    scores = itertools.chain([3.0, 1.0, 2.0], itertools.repeat(5.0))
    x, y = linear_problem()
    net = mlp(3, 2, 0, 0)

    def score() -> float:
        at_look.append(net[0].weight.detach().clone())
        return next(scores)

    regress(net, lambda r: net(x[r]) - y[r], len(x), Regression(100, 32, 0.05), score=score)
    assert len(at_look) == 10
    assert torch.equal(net[0].weight, at_look[1])
    assert not torch.equal(net[0].weight, at_look[-1])


def test_loss_is_told_how_far_training_is() -> None:
    told: list[float] = []

    def loss(error: torch.Tensor, progress: float) -> torch.Tensor:
        told.append(progress)
        return (error**2).mean()

    fitted(Regression(4, 8, 0.01), loss=loss)
    assert told == [0.0, 0.25, 0.5, 0.75]
