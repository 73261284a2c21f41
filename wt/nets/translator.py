"""G and D: unpaired translation of dynamics features between the domains (CycleGAN)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from wt.config import Method
from wt.nets.mlp import mlp


class Generator(nn.Module):
    """ẑ = z + g(z), or z + g(z, o, a) when conditioned; starts as the identity."""

    def __init__(self, latent: int, condition: int, width: int, depth: int) -> None:
        """Build the generator.

        Args:
            latent: size of z.
            condition: size of the normalised (o, a), or 0 for the paper's unconditioned map.
            width: units per hidden layer.
            depth: hidden layers.
        """
        super().__init__()
        self.conditioned = condition > 0
        self.net = mlp(latent + condition, latent, width, depth, zero_last=True)

    def forward(
        self, z: Float[Tensor, "batch latent"], x: Float[Tensor, "batch condition"]
    ) -> Float[Tensor, "batch latent"]:
        """The feature translated to the other domain."""
        return z + self.net(torch.cat([z, x], dim=-1) if self.conditioned else z)


class Discriminator(nn.Module):
    """Real features of a domain against translated ones; logits, positive for real."""

    def __init__(self, latent: int, condition: int, width: int, depth: int) -> None:
        """Build the discriminator; arguments as for :class:`Generator`."""
        super().__init__()
        self.conditioned = condition > 0
        self.net = mlp(latent + condition, 1, width, depth, lambda: nn.LeakyReLU(0.2))

    def forward(
        self, z: Float[Tensor, "batch latent"], x: Float[Tensor, "batch condition"]
    ) -> Float[Tensor, " batch"]:
        """Likeness of z to a feature of this domain."""
        return self.net(torch.cat([z, x], dim=-1) if self.conditioned else z).squeeze(-1)


class Translator(nn.Module):
    """Both generators and both discriminators; what is translated is up to who has them.

    Attributes:
        method: sizes, weights and kind of the losses.
        to_real: G_{S→R}.
        to_sim: G_{R→S}.
        discriminator_real: D_R.
        discriminator_sim: D_S.
    """

    method: Method
    to_real: Generator
    to_sim: Generator
    discriminator_real: Discriminator
    discriminator_sim: Discriminator

    def _translating(self, latent: int, condition: int, method: Method) -> None:
        """Build the networks; the first two arguments as for :class:`Generator`."""
        self.method = method
        size = (latent, condition, method.nets.translator_width, method.nets.translator_depth)
        self.to_real, self.to_sim = Generator(*size), Generator(*size)
        self.discriminator_real, self.discriminator_sim = Discriminator(*size), Discriminator(*size)
