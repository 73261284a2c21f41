"""Algorithm 1 of the paper as a LightningModule with manual optimization."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import lightning
import torch
from lightning.pytorch.core.optimizer import LightningOptimizer
from lightning.pytorch.strategies import DDPStrategy
from pydantic import TypeAdapter
from torch import Tensor, nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR, LRScheduler

from wt.config import Method
from wt.errors import ConfigError
from wt.nets.world_model import WorldModel
from wt.train import graphs, phases, replicas
from wt.train.batches import StepBatch
from wt.train.score import PairTensors, errors, reconstructions, score
from wt.train.selection import Selection
from wt.types import TransitionSpec

WARM_UP = 100
"""Steps over which learning rates rise; they then fall along a cosine to zero."""

_COLUMNS = {"discriminators": "judges"}
"""Optimizers whose metrics have an older name, by which runs are compared."""


class WorldTranslation(lightning.LightningModule):
    """Trains a :class:`WorldModel`; ``training_step`` reads like Algorithm 1.

    Attributes:
        model: the networks.
        metrics: those of the last step, by name; callbacks read them.
    """

    def __init__(
        self,
        spec: TransitionSpec | Mapping[str, Any],
        method: Method | Mapping[str, Any],
        model: WorldModel | None = None,
    ) -> None:
        """Wrap a model, or a new one that a checkpoint fills.

        Args:
            spec: layout of the transitions, or its plain content, as a checkpoint has it.
            method: which World Translation, or its plain content.
            model: the networks, with a fitted frame.
        """
        super().__init__()
        spec = TypeAdapter(TransitionSpec).validate_python(spec)
        method = TypeAdapter(Method).validate_python(method)
        self.save_hyperparameters({"spec": asdict(spec), "method": asdict(method)})
        self.automatic_optimization = False
        self.model = model = model or WorldModel(spec, method)
        self.metrics: dict[str, Tensor] = {}
        self._graphs: graphs.Graphs | None = None
        self.average = copy.deepcopy(model.to_real).requires_grad_(False)

    def configure_optimizers(self) -> tuple[list[Optimizer], list[LRScheduler]]:
        """Four: (φ, θ, ξ), ψ, generators, discriminators; all with one schedule."""
        m, train = self.model, self.model.method.train
        # listed once: to ask modules for their parameters in every step takes 2 % of it
        self._groups = {
            "vae": _parameters(m.encoder, m.decoder, m.classifier),
            "blind": _parameters(m.blind),
            "generators": _parameters(m.to_real, m.to_sim),
            "discriminators": _parameters(m.discriminator_real, m.discriminator_sim),
        }
        gan = {"generators", "discriminators"}
        optimizers: list[Optimizer] = [
            torch.optim.Adam(
                parameters,
                lr=train.gan_learning_rate if name in gan else train.learning_rate,
                betas=(0.5, 0.9) if name in gan else (0.9, 0.999),
                fused=True,
            )
            for name, parameters in self._groups.items()
        ]

        def share(step: int) -> float:  # a plain function: a checkpoint keeps no method
            return _share(step, train.steps)

        return optimizers, [LambdaLR(optimizer, share) for optimizer in optimizers]

    def setup(self, stage: str) -> None:
        """Refuse a strategy that waits for gradients which an optimizer's turn does not give.

        Raises:
            ConfigError: Lightning's DDP wraps the module.
        """
        strategy = self.trainer.strategy
        if isinstance(strategy, DDPStrategy) and not isinstance(strategy, replicas.Unwrapped):
            raise ConfigError(
                "Algorithm 1 averages its gradients itself, optimizer by optimizer; give "
                "Trainer(strategy=wt.train.replicas.Unwrapped()) instead of Lightning's own DDP"
            )

    def on_train_start(self) -> None:
        """Replay steps as graphs where a CUDA device can."""
        train = self.model.method.train
        if train.cuda_graphs and self.device.type == "cuda" and train.precision == "32-true":
            self._graphs = graphs.Graphs(partial(phases.iteration, self.model), self._each)

    def on_train_end(self) -> None:
        """Give back the memory of the graphs."""
        self._graphs = None

    def transfer_batch_to_device(
        self, batch: object, device: torch.device, dataloader_idx: int
    ) -> object:
        """A batch of training, which is made where it is used, as it is; pairs where they go."""
        if isinstance(batch, StepBatch):
            return batch
        return super().transfer_batch_to_device(batch, device, dataloader_idx)

    def training_step(self, batch: StepBatch, batch_idx: int) -> None:
        """One iteration of Algorithm 1's loop."""
        metrics: phases.Metrics = {}
        optimizers, gradients = self._each_optimizer(), self._gradients(batch, metrics)
        for optimizer, _ in zip(optimizers, gradients, strict=True):
            replicas.average(optimizer.param_groups[0]["params"])
            self._update(optimizer)
        self._follow_average()
        self._follow_schedule()
        self.metrics = {name: value.detach() for name, value in metrics.items()}
        if self.global_step % self.trainer.log_every_n_steps == 0:  # type: ignore[attr-defined]
            together = self.trainer.world_size > 1
            self.log_dict(self.metrics | self.gradient_norms(), sync_dist=together)
            self._log_step()

    def validation_step(self, batch: Selection, batch_idx: int) -> None:
        """Error on what is held out, with the averaged generator."""
        frame = self.model.frame
        # what the encoder keeps of R's own outcome, and what is left without translation
        real = PairTensors.of(batch.predicted, frame.state.std, frame.change.std)
        kept = (reconstructions(self.model, real) - real.real_next) / real.state_std
        values = {
            batch.metric: score(self.deployed(), batch),
            "self_reconstruction": float((kept**2).mean()),
            "untranslated": score(self.model.untranslated(), batch),
        }
        for name, value in values.items():
            self.log(f"val/{name}", value, batch_size=1)
        self._log_step()

    def test_step(self, batch: Sequence[Tensor], batch_idx: int) -> None:
        """Error on pairs of a model that would be exported now.

        Args:
            batch: observations, actions, next states of S and of R, as test loaders give them.
            batch_idx: not used.
        """
        frame = self.model.frame
        o, a, sim_next, real_next = batch
        pairs = PairTensors(o, a, sim_next, real_next, frame.state.std, frame.change.std)
        names = ("test/mse", "test/mse_change")
        values = dict(zip(names, errors(self.deployed(), pairs), strict=True))
        self.log_dict(values, batch_size=len(pairs.o))

    def deployed(self) -> WorldModel:
        """The model as it would be exported now, sharing all but an averaged generator."""
        if not self.model.method.translation.average:
            return self.model
        return self.model.with_generator(self.average)

    def gradient_norms(self) -> dict[str, Tensor]:
        """Norm of the last gradient of each optimizer's parameters."""
        return {
            f"gradient/{_COLUMNS.get(name, name)}": torch.nn.utils.get_total_norm(
                [p.grad for p in parameters if p.grad is not None]
            )
            for name, parameters in self._groups.items()
        }

    @property
    def _each(self) -> list[list[nn.Parameter]]:
        """Parameters of each optimizer."""
        return list(self._groups.values())

    def _each_optimizer(self) -> list[LightningOptimizer]:
        optimizers = self.optimizers()
        return optimizers if isinstance(optimizers, list) else [optimizers]

    def _update(self, optimizer: LightningOptimizer) -> None:
        """Step an optimizer, of which Lightning counts the last one's steps alone.

        So its ``global_step`` is that of the algorithm, which decides batches, noise and learning
        rates; else it would be four times as large.
        """
        plain = optimizer.optimizer
        if plain is self.trainer.optimizers[-1]:
            optimizer.step()
        else:
            self.trainer.strategy.optimizer_step(plain, _nothing)

    def _gradients(self, batch: StepBatch, metrics: phases.Metrics) -> Iterator[None]:
        """Compute the gradients of one update after the other, of the networks as they then are."""
        if self._graphs:
            return self._graphs.gradients(batch, metrics)
        # not by manual_backward: neither precision scales losses, graphs could not call its hooks,
        # and these take a fortieth of a step
        return graphs.gradients(phases.iteration(self.model, batch, metrics), self._each)

    def _follow_schedule(self) -> None:
        schedules = self.lr_schedulers()
        for schedule in schedules if isinstance(schedules, list) else [schedules]:
            schedule.step()  # type: ignore[union-attr]

    def _log_step(self) -> None:
        """Say where on the axis this is: of itself Lightning names the step that was begun last."""
        self.log("step", float(self.global_step), batch_size=1)

    @torch.no_grad()
    def _follow_average(self) -> None:
        decay = self.model.method.translation.average
        if decay:
            average: list[Tensor] = list(self.average.parameters())
            current: list[Tensor] = list(self.model.to_real.parameters())
            torch._foreach_lerp_(average, current, 1.0 - decay)


def _share(step: int, steps: int) -> float:
    """Learning rates at a step, as a share of their peak."""
    return min(1.0, (step + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * step / steps))


def _nothing() -> None:
    """The closure of an optimizer whose gradients are there."""


def _parameters(*modules: nn.Module) -> list[nn.Parameter]:
    return [p for module in modules for p in module.parameters()]
