"""FlowTranslation: the paper's features, translated by a flow instead of a CycleGAN.

Encoder and decoder are trained as in Algorithm 1, as large and with the prior that the task gives
the paper's method. Features of S are carried to features of R along the velocity v(z, t) of a flow,
which is matched to straight lines between features that are paired by optimal transport within each
batch. Tong et al., "Improving and generalizing flow-based generative models with minibatch optimal
transport" (2024), there called OT-CFM.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment
from torch import Tensor, nn
from torch.optim.lr_scheduler import LambdaLR

from wt.baselines.base import Baseline, register
from wt.config import Method
from wt.nets.mlp import CHUNK, mlp
from wt.nets.world_model import WorldModel
from wt.train import phases
from wt.train.batches import Held, StepBatch, StepBatches, in_frame
from wt.train.device import seeded
from wt.train.regression import BestWeights, Progress, tell
from wt.translate import translate_state
from wt.types import Pairs, Transitions

COUPLED = 256
"""Features of either domain that are paired at once; the time that takes grows with the cube."""
STEPS = 8
"""Steps of the integration of the flow, by the midpoint rule."""


class Flow(nn.Module):
    """The flow from features of S to features of R."""

    def __init__(self, latent: int, width: int, depth: int) -> None:
        """Start as no motion at all.

        Args:
            latent: size of z.
            width: units per hidden layer.
            depth: hidden layers.
        """
        super().__init__()
        self.net = mlp(latent + 1, latent, width, depth, zero_last=True)

    def velocity(self, z: Tensor, t: Tensor) -> Tensor:
        """v(z, t), (batch, latent), at times t in 0 … 1, (batch, 1)."""
        v: Tensor = self.net(torch.cat([z, t], dim=-1))
        return v

    def forward(self, z: Tensor, x: Tensor) -> Tensor:
        """Where a feature of S arrives; in the place of a generator, which is also shown (o, a)."""
        dt = 1.0 / STEPS
        for k in range(STEPS):
            t = z.new_full((len(z), 1), k * dt)
            half = z + 0.5 * dt * self.velocity(z, t)
            z = z + dt * self.velocity(half, t + 0.5 * dt)
        return z


@register
class FlowTranslation(Baseline):
    """o′ = D(o, a, flow of E(o, a, o′_S)); networks as large as the paper's method's."""

    name = "FlowTranslation"
    trains_on = ("sim", "real")
    translates = True

    def build(self) -> dict[str, nn.Module]:
        """The networks and weights of the paper's method, with a flow for CycleGAN's."""
        self.method = Method(nets=self.paper.nets, vae=self.paper.vae)
        nets = self.method.nets
        self.model = WorldModel(self.spec, self.method)
        self.model.frame = self.frame
        for name in ("to_sim", "discriminator_real", "discriminator_sim"):
            delattr(self.model, name)
        self.flow = Flow(nets.latent, nets.width, nets.depth)
        self.model.add_module("to_real", self.flow)
        return {"model": self.model}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Algorithm 1 with a flow in its second half."""
        settings, model, budget = self.settings, self.model, self.budget()
        vae = [model.encoder, model.decoder, model.classifier]
        groups = [nn.ModuleList(vae), model.blind, self.flow]
        # at half a regressor's rate, as the paper's networks are trained
        optimizers = [torch.optim.AdamW(group.parameters(), lr=0.5) for group in groups]
        schedules = [LambdaLR(optimizer, budget.rate) for optimizer in optimizers]
        of_sim, of_real = (Held(data) for data in in_frame(self.frame, sim, real))
        latent = self.method.nets.latent
        batches = StepBatches(of_sim, of_real, settings.batch, latent, self.seed)
        times, best = seeded(self.seed), BestWeights(model, self.score(), settings.steps)
        for step in range(settings.steps):
            losses = self._losses(batches.at(step), times)
            for optimizer, loss in zip(optimizers, losses, strict=True):
                optimizer.zero_grad()
                # L_VAE reaches through the blind decoder: only this group's parameters may move
                loss.backward(inputs=optimizer.param_groups[0]["params"])
                optimizer.step()
            for schedule in schedules:
                schedule.step()
            tell(progress, step + 1, settings.steps)
            best.look(step)
        best.restore()
        model.eval()

    @torch.no_grad()
    def predict(self, pairs: Pairs) -> np.ndarray:
        """S's answer, translated."""
        real = pairs.real
        rows = (torch.tensor(part).split(CHUNK) for part in (real.o, real.a, pairs.sim_next))
        parts = [translate_state(self.model, *part) for part in zip(*rows, strict=True)]
        return torch.cat(parts).cpu().numpy()

    def _losses(self, batch: StepBatch, times: torch.Generator) -> Iterator[Tensor]:
        """Of (φ, θ, ξ), of ψ, and of the flow, each once the one before it has been stepped."""
        loss, _, z = phases.extraction(self.model, batch)
        yield loss
        yield phases.blind(self.model, batch, z)[0]
        # the means, which are translated in use: samples of silent latents would be most of what
        # a transport has to carry
        with torch.no_grad():
            z_sim, z_real = (self.model.encoder(d.x, d.y)[0] for d in batch.gan)
        z_sim, z_real = coupled(z_sim, z_real)
        t = torch.rand(len(z_sim), 1, generator=times)
        velocity = self.flow.velocity(torch.lerp(z_sim, z_real, t), t)
        # E ‖v((1 − t) z_S + t z_R, t) − (z_R − z_S)‖²
        yield ((velocity - (z_real - z_sim)) ** 2).sum(-1).mean()


def coupled(
    a: Float[Tensor, "batch latent"], b: Float[Tensor, "batch latent"]
) -> tuple[Float[Tensor, "batch latent"], Float[Tensor, "batch latent"]]:
    """Rows of both, each beside its partner under the optimal transport within part of a batch."""
    partners = []
    for start, (x, y) in enumerate(zip(a.split(COUPLED), b.split(COUPLED), strict=True)):
        _, partner = linear_sum_assignment(torch.cdist(x, y).square().cpu().numpy())
        partners.append(torch.tensor(partner) + start * COUPLED)
    return a, b[torch.cat(partners)]
