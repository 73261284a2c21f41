"""D_ψ: tries to predict the next observation from z alone, to catch z that copies it."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from wt.nets.mlp import mlp


class BlindDecoder(nn.Module):
    """õ′ = D_ψ(z), "Challenge 1" of the paper."""

    def __init__(self, latent: int, state: int, width: int, depth: int) -> None:
        """Build the blind decoder.

        Args:
            latent: size of z.
            state: size of the normalised next state.
            width: units per hidden layer.
            depth: hidden layers.
        """
        super().__init__()
        self.net = mlp(latent, state, width, depth)

    def forward(self, z: Float[Tensor, "batch latent"]) -> Float[Tensor, "batch state"]:
        """The next state, normalised, as far as z gives it away."""
        return self.net(z)
