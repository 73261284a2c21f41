"""Checkpoints that are whole whatever interrupts their writing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO


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
