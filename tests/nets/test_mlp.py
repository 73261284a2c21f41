from __future__ import annotations

import numpy as np
import torch
from torch import nn

from wt.nets.mlp import Ensemble, mlp


def test_layers_are_hidden_ones_then_a_linear_output() -> None:
    torch.manual_seed(0)
    net, x = mlp(3, 2, 5, 2), torch.randn(4, 3)
    w = [(m.weight.detach().numpy(), m.bias.detach().numpy()) for m in net[::2]]
    assert [weight.shape for weight, _ in w] == [(5, 3), (5, 5), (2, 5)]
    h = x.numpy()
    for weight, bias in w[:-1]:
        h = h @ weight.T + bias
        h = h / (1 + np.exp(-h))  # SiLU
    expected = h @ w[-1][0].T + w[-1][1]
    np.testing.assert_allclose(net(x).detach().numpy(), expected, atol=1e-6)


def test_depth_zero_is_linear_and_zero_last_starts_at_zero() -> None:
    assert [type(m) for m in mlp(3, 2, 5, 0)] == [nn.Linear]
    silent = mlp(3, 2, 5, 2, zero_last=True)
    assert torch.equal(silent(torch.randn(4, 3)), torch.zeros(4, 2))
    # and it can still learn: the gradient of its last layer is not zero
    silent(torch.randn(4, 3)).sum().backward()
    assert silent[-1].weight.grad.abs().max() > 0


def test_ensemble_is_the_mean_of_its_members() -> None:
    torch.manual_seed(0)
    members, x = [mlp(3, 2, 5, 1) for _ in range(3)], torch.randn(4, 3)
    expected = np.mean([m(x).detach().numpy() for m in members], axis=0)
    np.testing.assert_allclose(Ensemble(members)(x).detach().numpy(), expected, atol=1e-6)
