"""E_φ: backward dynamics extraction, from a transition to its dynamics feature z."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wt.nets.mlp import mlp

LOG_VARIANCE_RANGE = (-12.0, 4.0)
"""log σ² is kept in this range, so that neither KL nor samples can overflow."""


class Encoder(nn.Module):
    """(μ, log σ²) = E_φ(o, a, o′), section "Backward Dynamics Extraction" of the paper."""

    def __init__(self, condition: int, target: int, latent: int, width: int, depth: int) -> None:
        """Build the encoder.

        Args:
            condition: size of the normalised (o, a).
            target: size of the normalised outcome.
            latent: size of z.
            width: units per hidden layer.
            depth: hidden layers.
        """
        super().__init__()
        self.net = mlp(condition + target, 2 * latent, width, depth)

    def forward(
        self, x: Float[Tensor, "batch condition"], y: Float[Tensor, "batch target"]
    ) -> tuple[Float[Tensor, "batch latent"], Float[Tensor, "batch latent"]]:
        """Mean and log variance of q_φ(z | o, a, o′)."""
        mean, log_variance = self.net(torch.cat([x, y], dim=-1)).chunk(2, dim=-1)
        return mean, log_variance.clamp(*LOG_VARIANCE_RANGE)
