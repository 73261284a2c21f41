"""D_θ: from (o, a) and a dynamics feature z to the outcome, modulated by z in every layer."""

from __future__ import annotations

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wt.nets.mlp import mlp


class FiLMDecoder(nn.Module):
    """ô′ = D_θ(o, a, z) with feature-wise linear modulation (Perez et al. 2018)."""

    def __init__(self, condition: int, target: int, latent: int, width: int, depth: int) -> None:
        """Build the decoder.

        Args:
            condition: size of the normalised (o, a).
            target: size of the normalised outcome.
            latent: size of z.
            width: units per hidden layer.
            depth: modulated hidden layers.
        """
        super().__init__()
        sizes = [condition] + [width] * depth
        self.layers = nn.ModuleList(nn.Linear(i, o) for i, o in pairwise(sizes))
        self.modulation = nn.Linear(latent, 2 * width * depth)
        self.activation = nn.SiLU()
        self.out = nn.Linear(width, target)

    def forward(
        self, x: Float[Tensor, "batch condition"], z: Float[Tensor, "batch latent"]
    ) -> Float[Tensor, "batch target"]:
        """The normalised outcome for condition x and feature z."""
        modulation = self.modulation(z).chunk(2 * len(self.layers), dim=-1)
        h = x
        for i, layer in enumerate(self.layers):
            gamma, beta = modulation[2 * i], modulation[2 * i + 1]
            # FiLM(o, a; z) = γ(z) ⊙ f(o, a) + β(z); γ is centred on one
            h = self.activation((1.0 + gamma) * layer(h) + beta)
        return self.out(h)


class ConcatDecoder(nn.Module):
    """The plain decoder that the paper compares FiLM with: an MLP of (o, a, z)."""

    def __init__(self, condition: int, target: int, latent: int, width: int, depth: int) -> None:
        """Build the decoder; arguments as for :class:`FiLMDecoder`."""
        super().__init__()
        self.net = mlp(condition + latent, target, width, depth)

    def forward(
        self, x: Float[Tensor, "batch condition"], z: Float[Tensor, "batch latent"]
    ) -> Float[Tensor, "batch target"]:
        """The normalised outcome for condition x and feature z."""
        return self.net(torch.cat([x, z], dim=-1))
