"""What watches a training: its progress, its curves, and its ways of collapsing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import lightning

from wt.errors import WorkError
from wt.train.module import WorldTranslation
from wt.train.regression import Progress

if TYPE_CHECKING:
    import rerun


class ShowProgress(lightning.Callback):
    """Tells how far the training is."""

    def __init__(self, progress: Progress, every: int) -> None:
        """Set up.

        Args:
            progress: called with (done, total) steps.
            every: steps between two calls.
        """
        self._progress, self._every = progress, every

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: object,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Tell it."""
        if trainer.global_step % self._every == 0:
            self._progress(trainer.global_step, _own(pl_module).model.method.train.steps)


class RerunCurves(lightning.Callback):
    """Draws the metrics into a recording for Rerun, which can be looked at while they grow.

    A training that is continued begins another recording: ``training_<step>.rrd``.
    """

    def __init__(self, folder: Path, every: int) -> None:
        """Set up.

        Args:
            folder: where recordings go.
            every: steps between two points.
        """
        self._folder, self._every = folder, every
        self._recording: rerun.RecordingStream | None = None

    def on_train_start(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Begin a recording."""
        import rerun

        self._folder.mkdir(parents=True, exist_ok=True)
        self._recording = rerun.RecordingStream("World Translation: training")
        self._recording.save(self._folder / f"training_{trainer.global_step}.rrd")

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: object,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Draw the step's metrics."""
        if trainer.global_step % self._every == 0:
            metrics = _own(pl_module).metrics
            self._draw({k: float(v) for k, v in metrics.items()}, trainer.global_step)

    def on_validation_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Draw what was measured on what is held out."""
        values = {k: float(v) for k, v in trainer.callback_metrics.items() if k.startswith("val/")}
        self._draw(values, trainer.global_step)

    def on_train_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Close the recording."""
        if self._recording:
            self._recording.disconnect()
        self._recording = None

    def _draw(self, values: Mapping[str, float], step: int) -> None:
        import rerun

        if self._recording is None:  # validation without training
            return
        self._recording.set_time("step", sequence=step)
        for name, value in values.items():
            self._recording.log(name, rerun.Scalars(value))


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
        self, warn: Callable[[str], None], every: int, limits: CollapseLimits | None = None
    ) -> None:
        """Set up.

        Args:
            warn: called with one line when something collapsed.
            every: steps between two looks.
            limits: thresholds.
        """
        self._warn, self._every = warn, every
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
        if trainer.global_step % self._every:
            return
        values = {k: float(v) for k, v in _own(pl_module).metrics.items()}
        self._refuse_divergence(values, trainer.global_step)
        limits = self._limits
        silent = values["latent/active_std"] < limits.latent_std
        self._count(trainer, "silent", silent,
                    "the latent went silent (posterior collapse): lower vae.beta")  # fmt: skip
        won = values["gan/accuracy"] > limits.accuracy
        won = won and values["gan/generator"] > limits.generator
        self._count(trainer, "won", won,
                    "the discriminators won (no useful gradient left): lower "
                    "train.gan_learning_rate or condition the translation")  # fmt: skip

    def on_validation_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Look at the validation error before anything is kept as a checkpoint."""
        values = {k: float(v) for k, v in trainer.callback_metrics.items()}
        self._refuse_divergence(values, trainer.global_step)

    def _refuse_divergence(self, values: Mapping[str, float], step: int) -> None:
        bad = [k for k, v in values.items() if not math.isfinite(v)]
        if bad:
            raise WorkError(
                f"training diverged at step {step}: {bad[0]} is {values[bad[0]]}; lower "
                "train.learning_rate or train.gan_learning_rate; an earlier checkpoint is kept"
            )

    def _count(self, trainer: lightning.Trainer, what: str, now: bool, advice: str) -> None:
        self._in_a_row[what] = self._in_a_row[what] + 1 if now else 0
        if self._in_a_row[what] >= self._limits.patience and what not in self._said:
            self._said.add(what)
            self._warn(f"training collapsed at step {trainer.global_step}: {advice}")
            for logger in trainer.loggers:
                logger.log_metrics({"collapsed": 1.0}, trainer.global_step)


def _own(module: lightning.LightningModule) -> WorldTranslation:
    if not isinstance(module, WorldTranslation):
        raise TypeError(f"this callback trains WorldTranslation, not {type(module).__name__}")
    return module
