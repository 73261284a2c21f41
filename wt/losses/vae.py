"""Terms of L_VAE (equation "vae_loss" of the paper)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F


def reconstruction(
    target: Float[Tensor, "batch channel"], predicted: Float[Tensor, "batch channel"]
) -> Float[Tensor, ""]:
    """Squared error summed over channels, as the KL term is over latents; mean over the batch."""
    # ‖o′ − ô′‖²
    return ((target - predicted) ** 2).sum(-1).mean()


def kl_divergence(
    mean: Float[Tensor, "batch latent"], log_variance: Float[Tensor, "batch latent"]
) -> Float[Tensor, ""]:
    """KL(q_φ(z) ‖ N(0, 1)) per sample [nat], averaged over the batch."""
    # ½ Σ (μ² + σ² − log σ² − 1)
    return 0.5 * (mean**2 + log_variance.exp() - log_variance - 1.0).sum(-1).mean()


def blind_penalty(
    target: Float[Tensor, "batch state"],
    blind: Float[Tensor, "batch state"],
    temperature: float,
) -> Float[Tensor, ""]:
    """High while the blind decoder succeeds, flat once it fails (equation "blind").

    Args:
        target: normalised next state.
        blind: what the blind decoder makes of z.
        temperature: σ_b, in units of the normalised error per channel.
    """
    # exp(−‖o′ − õ′‖² / σ_b²), the norm divided by the number of channels
    error = ((target - blind) ** 2).mean(-1)
    return torch.exp(-error / temperature**2).mean()


def domain_classification(
    logit_sim: Float[Tensor, " sim"], logit_real: Float[Tensor, " real"]
) -> Float[Tensor, ""]:
    """Binary cross-entropy of C_ξ with d = 0 for S and d = 1 for R."""
    # BCE(C_ξ(z), d)
    zeros, ones = torch.zeros_like(logit_sim), torch.ones_like(logit_real)
    return 0.5 * (
        F.binary_cross_entropy_with_logits(logit_sim, zeros)
        + F.binary_cross_entropy_with_logits(logit_real, ones)
    )
