"""Algorithm 1 of the paper as a LightningModule with manual optimization."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable
from typing import Any

import lightning
import torch
from lightning.pytorch.core.optimizer import LightningOptimizer
from torch import Tensor, nn

from wt.nets.world_model import WorldModel
from wt.train import phases
from wt.train.batches import StepBatch
from wt.train.score import PairTensors, errors
from wt.train.segments import segment_error

WARM_UP = 100
"""Steps over which learning rates rise; they then fall along a cosine to zero."""

_COLUMNS = {"discriminators": "judges"}
"""Optimizers whose metrics have an older name, by which runs are compared."""


class WorldTranslation(lightning.LightningModule):
    """Trains a :class:`WorldModel`; ``training_step`` reads like Algorithm 1.

    Attributes:
        model: the networks.
        own_step: steps done. Lightning's ``global_step`` counts every optimizer and is not used.
        metrics: those of the last step, by name; callbacks read them.
    """

    def __init__(self, model: WorldModel, pairs: PairTensors) -> None:
        """Wrap a model.

        Args:
            model: the networks, with a fitted frame.
            pairs: validation pairs; they choose the checkpoint and train nothing.
        """
        super().__init__()
        self.automatic_optimization = False
        self.model = model
        self._pairs = pairs
        self.own_step = 0
        self.metrics: dict[str, Tensor] = {}
        self.average = copy.deepcopy(model.to_real).requires_grad_(False)

    def configure_optimizers(self) -> list[torch.optim.Optimizer]:
        """Four: (φ, θ, ξ), ψ, generators, discriminators."""
        m, train = self.model, self.model.method.train
        self._groups: dict[str, list[nn.Module]] = {
            "vae": [m.encoder, m.decoder, m.classifier],
            "blind": [m.blind],
            "generators": [m.to_real, m.to_sim],
            "discriminators": [m.discriminator_real, m.discriminator_sim],
        }
        gan = {"generators", "discriminators"}
        return [
            torch.optim.Adam(
                _parameters(modules),
                lr=train.gan_learning_rate if name in gan else train.learning_rate,
                betas=(0.5, 0.9) if name in gan else (0.9, 0.999),
                fused=True,
            )
            for name, modules in self._groups.items()
        ]

    def training_step(self, batch: StepBatch, batch_idx: int) -> None:
        """One iteration of Algorithm 1's loop."""
        self._set_learning_rates()
        vae, blind, generators, discriminators = self._each_optimizer()
        # Backward Dynamics Extraction: update φ, θ, ξ, then ψ with z detached
        loss, metrics, z = phases.extraction(self.model, batch)
        if batch.segment is not None:
            along = segment_error(self.model, batch.segment)
            loss = loss + self.model.method.train.segment_weight * along
            metrics["vae/segment"] = along
        self._update(vae, loss)
        loss, more = phases.blind(self.model, batch, z)
        self._update(blind, loss)
        metrics |= more
        # Unpaired Domain Translation: update both generators, then both discriminators
        z_sim, z_real = phases.encode(self.model, batch)
        loss, more, fakes = phases.generators(self.model, batch.gan, z_sim, z_real)
        self._update(generators, loss)
        metrics |= more
        loss, more = phases.discriminators(self.model, batch.gan, z_sim, z_real, fakes)
        self._update(discriminators, loss)
        metrics |= more
        self._follow_average()
        self.metrics = {name: value.detach() for name, value in metrics.items()}
        self.own_step += 1

    def validation_step(self, batch: object, batch_idx: int) -> None:
        """Error on the validation pairs, with the averaged generator."""
        mse, mse_change = errors(self.deployed(), self._pairs)
        self.log("val/mse", mse)
        self.log("val/mse_change", mse_change)

    def deployed(self) -> WorldModel:
        """The model as it would be exported now, sharing all but an averaged generator."""
        if not self.model.method.translation.average:
            return self.model
        model = copy.copy(self.model)
        model._modules = dict(self.model._modules)
        model.to_real = self.average
        return model

    def gradient_norms(self) -> dict[str, Tensor]:
        """Norm of the last gradient of each optimizer's parameters."""
        return {
            f"gradient/{_COLUMNS.get(name, name)}": torch.nn.utils.get_total_norm(
                [p.grad for p in _parameters(modules) if p.grad is not None]
            )
            for name, modules in self._groups.items()
        }

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the step, which decides batches, noise and learning rates."""
        checkpoint["own_step"] = self.own_step

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Continue where the checkpoint was written."""
        self.own_step = checkpoint["own_step"]

    def _each_optimizer(self) -> list[LightningOptimizer]:
        optimizers = self.optimizers()
        return optimizers if isinstance(optimizers, list) else [optimizers]

    def _update(self, optimizer: LightningOptimizer, loss: Tensor) -> None:
        optimizer.zero_grad()
        # losses reach through other networks (D in the generators' loss, D_ψ in L_VAE):
        # only this optimizer's parameters collect a gradient
        self.manual_backward(loss, inputs=optimizer.param_groups[0]["params"])
        optimizer.step()

    def _set_learning_rates(self) -> None:
        train = self.model.method.train
        progress = self.own_step / train.steps
        factor = min(1.0, (self.own_step + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * progress))
        rates = (train.learning_rate, train.learning_rate) + 2 * (train.gan_learning_rate,)
        for optimizer, rate in zip(self._each_optimizer(), rates, strict=True):
            optimizer.param_groups[0]["lr"] = rate * factor

    @torch.no_grad()
    def _follow_average(self) -> None:
        decay = self.model.method.translation.average
        if decay:
            average: list[Tensor] = list(self.average.parameters())
            current: list[Tensor] = list(self.model.to_real.parameters())
            torch._foreach_lerp_(average, current, 1.0 - decay)


def _parameters(modules: Iterable[nn.Module]) -> list[nn.Parameter]:
    return [p for module in modules for p in module.parameters()]
