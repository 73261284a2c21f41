from __future__ import annotations

import torch

from wt.nets.blind_decoder import BlindDecoder
from wt.nets.classifier import DomainClassifier


def test_one_logit_a_row() -> None:
    assert DomainClassifier(4, 8, 2)(torch.randn(1, 4)).shape == (1,)
    assert DomainClassifier(4, 8, 2)(torch.randn(7, 4)).shape == (7,)


def test_blind_decoder_sees_the_feature_only() -> None:
    # its forward takes nothing else, and what it takes it uses in full
    z = torch.randn(5, 4, requires_grad=True)
    (gradient,) = torch.autograd.grad(BlindDecoder(4, 3, 8, 2)(z).sum(), z)
    assert (gradient.abs().sum(0) > 0).all()
