"""Logging of Algorithm 1's inner life, and a watch for its ways of collapsing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import lightning

from wt.errors import WorkError
from wt.train.batches import StepBatches
from wt.train.module import WorldTranslation
from wt.train.regression import Progress

MetricSink = Callable[[Mapping[str, float], int], None]
"""Called with metrics by name and the step they belong to."""


class StartAtOwnStep(lightning.Callback):
    """Hands the module's own step to the batches whenever an epoch starts, also after resume."""

    def __init__(self, batches: StepBatches) -> None:
        """Keep the batches whose step is set."""
        self._batches = batches

    def on_train_epoch_start(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Lightning prefetches a batch past an epoch's end; go back to the true step."""
        self._batches.next_step = _own(pl_module).own_step


class Log(lightning.Callback):
    """Every few steps: losses, accuracies, latent statistics and gradient norms."""

    def __init__(self, sink: MetricSink, every: int, progress: Progress | None = None) -> None:
        """Set up.

        Args:
            sink: where metrics go.
            every: steps between two logs.
            progress: called with (done, total) steps.
        """
        self._sink, self._every, self._progress = sink, every, progress

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: object,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Read the step's metrics and hand them on."""
        module = _own(pl_module)
        if module.own_step % self._every:
            return
        values = module.metrics | module.gradient_norms()
        self._sink({k: float(v) for k, v in values.items()}, module.own_step)
        if self._progress:
            self._progress(module.own_step, module.model.method.train.steps)

    def on_validation_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Hand on the error on the validation pairs."""
        values = {k: float(v) for k, v in trainer.callback_metrics.items()}
        self._sink(values, _own(pl_module).own_step)


@dataclass(frozen=True)
class CollapseLimits:
    """Limits beyond which a run counts as collapsed.

    Attributes:
        patience: logs in a row that must agree.
        accuracy: discriminators right more often than this have won for good [-].
        generator: … while the generators' adversarial loss is above this.
        latent_std: posterior means that vary less than this carry nothing [-].
    """

    patience: int = 20
    accuracy: float = 0.98
    generator: float = 3.0
    latent_std: float = 1e-2


class CollapseWatch(lightning.Callback):
    """Says so when training diverges, when z goes silent, or when the discriminators win.

    Divergence ends the run (:class:`WorkError`); the other two are reported once through
    ``warn`` and as the metric ``collapsed``, since checkpoints from before remain usable.
    """

    def __init__(
        self, sink: MetricSink, warn: Callable[[str], None], every: int,
        limits: CollapseLimits | None = None,
    ) -> None:  # fmt: skip
        """Set up.

        Args:
            sink: where the metric ``collapsed`` goes.
            warn: called with one line when something collapsed.
            every: steps between two looks.
            limits: thresholds.
        """
        self._sink, self._warn, self._every = sink, warn, every
        self._limits = limits or CollapseLimits()
        self._in_a_row = {"silent": 0, "won": 0}
        self._said: set[str] = set()

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: object,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Look at the step's metrics."""
        module = _own(pl_module)
        if module.own_step % self._every:
            return
        values = {k: float(v) for k, v in module.metrics.items()}
        self._refuse_divergence(values, module.own_step)
        limits = self._limits
        self._count("silent", values["latent/active_std"] < limits.latent_std, module.own_step,
                    "the latent went silent (posterior collapse): lower vae.beta")  # fmt: skip
        won = values["gan/accuracy"] > limits.accuracy
        won = won and values["gan/generator"] > limits.generator
        self._count("won", won, module.own_step,
                    "the discriminators won (no useful gradient left): lower "
                    "train.gan_learning_rate or condition the translation")  # fmt: skip

    def on_validation_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Look at the validation error before anything is kept as a checkpoint."""
        values = {k: float(v) for k, v in trainer.callback_metrics.items()}
        self._refuse_divergence(values, _own(pl_module).own_step)

    def _refuse_divergence(self, values: Mapping[str, float], step: int) -> None:
        bad = [k for k, v in values.items() if not math.isfinite(v)]
        if bad:
            raise WorkError(
                f"training diverged at step {step}: {bad[0]} is {values[bad[0]]}; lower "
                "train.learning_rate or train.gan_learning_rate; the best checkpoint so far is kept"
            )

    def _count(self, what: str, now: bool, step: int, advice: str) -> None:
        self._in_a_row[what] = self._in_a_row[what] + 1 if now else 0
        if self._in_a_row[what] >= self._limits.patience and what not in self._said:
            self._said.add(what)
            self._warn(f"training collapsed at step {step}: {advice}")
            self._sink({"collapsed": 1.0}, step)


def _own(module: lightning.LightningModule) -> WorldTranslation:
    if not isinstance(module, WorldTranslation):
        raise TypeError(f"this callback trains WorldTranslation, not {type(module).__name__}")
    return module
