from __future__ import annotations

import jaxtyping
import pytest
import torch

from wt.nets.encoder import LOG_VARIANCE_RANGE, Encoder


def test_log_variance_stays_where_samples_and_kl_are_finite() -> None:
    torch.manual_seed(0)
    encoder = Encoder(3, 2, 4, 8, 1)
    with torch.no_grad():
        encoder.net[-1].weight.mul_(1e6)
    mean, log_variance = encoder(torch.randn(64, 3), torch.randn(64, 2))
    low, high = LOG_VARIANCE_RANGE
    assert log_variance.min() == low and log_variance.max() == high
    assert mean.abs().max() > 1e3  # the mean is free
    assert torch.isfinite(log_variance.exp()).all()


def test_mean_and_log_variance_depend_on_condition_and_outcome() -> None:
    torch.manual_seed(0)
    encoder = Encoder(3, 2, 4, 8, 1)
    x, y = torch.randn(5, 3, requires_grad=True), torch.randn(5, 2, requires_grad=True)
    for part in encoder(x, y):
        for gradient in torch.autograd.grad(part.sum(), (x, y), retain_graph=True):
            assert (gradient.abs().sum(0) > 0).all()


def test_wrong_shapes_are_refused_while_tests_run() -> None:
    encoder = Encoder(3, 2, 4, 8, 1)
    with pytest.raises(jaxtyping.TypeCheckError, match="batch"):
        encoder(torch.zeros(5, 3), torch.zeros(6, 2))
