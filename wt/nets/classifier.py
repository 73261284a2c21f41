"""C_ξ: which domain a dynamics feature comes from, so that z must carry the domain."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from wt.nets.mlp import mlp


class DomainClassifier(nn.Module):
    """d̂ = C_ξ(z), "Challenge 2" of the paper; logits, positive for R."""

    def __init__(self, latent: int, width: int, depth: int) -> None:
        """Build the classifier.

        Args:
            latent: size of z.
            width: units per hidden layer.
            depth: hidden layers.
        """
        super().__init__()
        self.net = mlp(latent, 1, width, depth)

    def forward(self, z: Float[Tensor, "batch latent"]) -> Float[Tensor, " batch"]:
        """Logit of "z comes from R"."""
        return self.net(z).squeeze(-1)
