"""Checkpoints: which one is kept, and that it is whole whatever interrupts its writing."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import lightning
import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch import Tensor


class WholeCheckpoints(TorchCheckpointIO):
    """Writes a checkpoint beside its place and renames it when whole.

    Lightning's own comes from the system's folder of temporary files. Where that is on another
    file system, moving it is a copy, which a kill or a full disk cuts short: nothing could be
    resumed from it.
    """

    def save_checkpoint(
        self,
        checkpoint: dict[str, Any],
        path: str | os.PathLike[str],
        storage_options: Any | None = None,  # noqa: ANN401 – Lightning's signature
    ) -> None:
        """Write ``checkpoint`` to ``path``, whole or not at all."""
        part = Path(path).with_suffix(".part")
        part.parent.mkdir(parents=True, exist_ok=True)
        try:
            torch.save(checkpoint, part)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


class LatestOfTheBest(ModelCheckpoint):
    """Keeps the latest checkpoint whose error is the lowest but for that one's standard error.

    See :class:`wt.train.selection.Selection`.
    """

    def __init__(self, folder: Path, monitor: str, standard_error: str) -> None:
        """Set up.

        Args:
            folder: ``best.ckpt`` is kept here.
            monitor: metric that chooses, the lower, the better.
            standard_error: metric, of that one.
        """
        super().__init__(folder, "best", monitor=monitor)
        self._standard_error = standard_error
        self._lowest = self._limit = math.inf

    def check_monitor_top_k(
        self, trainer: lightning.Trainer, current: Tensor | None = None
    ) -> bool:
        """Whether this checkpoint takes the place of the one that is kept."""
        if current is None:
            return False
        error = float(current)
        if error < self._lowest:
            self._lowest = error
            self._limit = error + float(trainer.callback_metrics[self._standard_error])
        # of several processes, all have the same data that choose
        return trainer.strategy.reduce_boolean_decision(error <= self._limit)

    def state_dict(self) -> dict[str, Any]:
        """With what the next checkpoint is compared with."""
        return {**super().state_dict(), "lowest": self._lowest, "limit": self._limit}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """See :meth:`state_dict`."""
        super().load_state_dict(state_dict)
        self._lowest, self._limit = state_dict["lowest"], state_dict["limit"]
