"""Normalisation that lives inside a model and is saved, moved and exported with it."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from wt.errors import DataError

_CONSTANT = 1e-6
"""A channel that varies by less than this share of its size is constant in float32."""


class Normalizer(nn.Module):
    """Subtracts each channel's mean and divides by its standard deviation.

    Both are buffers, so they are saved, moved and exported with the model that owns them. A
    freshly made one changes nothing: load a state into it or call :meth:`fit`.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, channels: int) -> None:
        """Make a normaliser for vectors of ``channels`` elements."""
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("std", torch.ones(channels))

    def fit(self, array: Shaped[np.ndarray, " ..."] | Shaped[Tensor, " ..."]) -> Normalizer:
        """Take mean and standard deviation from a sample, in place.

        A constant channel is only centred: dividing by its vanishing spread would turn the
        first deviation outside the sample into an enormous input.

        Args:
            array: sample, (N, channels), N >= 1, in any unit.

        Returns:
            This normaliser, so that ``Normalizer(channels).fit(array)`` is one expression.

        Raises:
            DataError: the sample is empty or has another number of channels.
        """
        sample = np.asarray(array.cpu() if isinstance(array, Tensor) else array)
        if sample.ndim != 2 or len(sample) == 0 or sample.shape[1] != len(self.mean):
            raise DataError(
                f"normaliser: a sample of shape {sample.shape} was given; "
                f"it needs at least one row of {len(self.mean)} channels"
            )
        mean = sample.mean(axis=0, dtype=np.float64)
        std = sample.std(axis=0, dtype=np.float64)
        size = np.abs(sample).max(axis=0)
        std = np.where(std > _CONSTANT * size, std, 1.0)
        self.mean.copy_(torch.from_numpy(mean))
        self.std.copy_(torch.from_numpy(std))
        return self

    def forward(self, x: Float[Tensor, "*batch channel"]) -> Float[Tensor, "*batch channel"]:
        """Normalise ``x`` from its own units."""
        return (x - self.mean) / self.std

    def inverse(self, z: Float[Tensor, "*batch channel"]) -> Float[Tensor, "*batch channel"]:
        """Undo :meth:`forward`: ``z`` back into its own units."""
        return z * self.std + self.mean
