from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.distributions import Normal, kl_divergence

from wt.losses import vae

RNG = np.random.default_rng(0)


def tensor(*shape: int) -> torch.Tensor:
    return torch.tensor(RNG.normal(size=shape), dtype=torch.float32)


def test_reconstruction_is_the_squared_norm_averaged_over_the_batch() -> None:
    target, predicted = tensor(7, 3), tensor(7, 3)
    by_hand = np.mean(np.linalg.norm(target.numpy() - predicted.numpy(), axis=1) ** 2)
    assert float(vae.reconstruction(target, predicted)) == pytest.approx(by_hand, rel=1e-6)


def test_kl_is_that_of_torch_distributions() -> None:
    mean, log_variance = tensor(5, 4), tensor(5, 4)
    q, p = Normal(mean, torch.exp(0.5 * log_variance)), Normal(0.0, 1.0)
    expected = kl_divergence(q, p).sum(-1).mean()
    torch.testing.assert_close(vae.kl_divergence(mean, log_variance), expected)
    assert float(vae.kl_divergence(torch.zeros(2, 4), torch.zeros(2, 4))) == 0.0


def test_blind_penalty_is_one_at_no_error_and_follows_the_exponential() -> None:
    target = tensor(6, 3)
    assert float(vae.blind_penalty(target, target, 0.5)) == 1.0
    guess = tensor(6, 3)
    error = np.mean((target.numpy() - guess.numpy()) ** 2, axis=1)
    expected = np.mean(np.exp(-error / 0.7**2))
    assert float(vae.blind_penalty(target, guess, 0.7)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("temperature", [0.3, 1.0])
def test_blind_penalty_pulls_at_most_so_much_and_lets_go(temperature: float) -> None:
    # one channel: d/dr exp(-r²/σ²) = -2r/σ² exp(-r²/σ²), steepest at r = σ/√2 with √(2/e)/σ
    r = torch.linspace(0.0, 20 * temperature, 4001, requires_grad=True)
    for_each = torch.stack(
        [vae.blind_penalty(torch.zeros(1, 1), e[None, None], temperature) for e in r[::40]]
    )
    (slope,) = torch.autograd.grad(for_each.sum(), r)
    slope = slope[::40].abs()
    bound = np.sqrt(2 / np.e) / temperature
    assert slope[0] == 0.0
    assert float(slope.max()) <= bound * (1 + 1e-6)
    assert float(slope.max()) > 0.9 * bound
    assert float(slope[-1]) < 1e-6


def test_domain_classification_is_cross_entropy_with_zero_for_sim() -> None:
    sim, real = tensor(9), tensor(4)
    p_sim, p_real = (1 / (1 + np.exp(-x.numpy().astype(float))) for x in (sim, real))
    by_hand = 0.5 * (-np.log(1 - p_sim).mean() - np.log(p_real).mean())
    assert float(vae.domain_classification(sim, real)) == pytest.approx(by_hand, rel=1e-5)
    sure = torch.full((3,), 50.0)
    assert float(vae.domain_classification(-sure, sure)) == pytest.approx(0.0, abs=1e-9)
    assert float(vae.domain_classification(sure, -sure)) == pytest.approx(50.0)
