"""Adversarial, cycle and identity losses of the translator (Algorithm 1, second half)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from wt.config import Adversarial


def discriminator(
    kind: Adversarial, real: Float[Tensor, " batch"], fake: Float[Tensor, " batch"]
) -> Float[Tensor, ""]:
    """Loss of a discriminator on logits of real and of translated features."""
    if kind == "bce":
        # −E[log D(z)] − E[log(1 − D(ẑ))]
        return F.softplus(-real).mean() + F.softplus(fake).mean()
    # ½ E[(D(z) − 1)²] + ½ E[D(ẑ)²]
    return 0.5 * ((real - 1.0) ** 2).mean() + 0.5 * (fake**2).mean()


def generator(kind: Adversarial, fake: Float[Tensor, " batch"]) -> Float[Tensor, ""]:
    """Adversarial loss of a generator on the discriminator's logits of its output."""
    if kind == "bce":
        # −E[log D(ẑ)], the non-saturating form
        return F.softplus(-fake).mean()
    # ½ E[(D(ẑ) − 1)²]
    return 0.5 * ((fake - 1.0) ** 2).mean()


def accuracy(
    kind: Adversarial, real: Float[Tensor, " batch"], fake: Float[Tensor, " batch"]
) -> Float[Tensor, ""]:
    """Share of features that a discriminator tells apart correctly [-]; 0.5 is chance."""
    threshold = 0.0 if kind == "bce" else 0.5
    right = (real > threshold).float().mean() + (fake <= threshold).float().mean()
    return 0.5 * right


def distance(a: Float[Tensor, "batch latent"], b: Float[Tensor, "batch latent"]) -> Tensor:
    """L1 distance of cycle and identity losses, averaged over batch and latent."""
    # ‖z − G(G(z))‖₁ or ‖z − G(z)‖₁
    return torch.abs(a - b).mean()
