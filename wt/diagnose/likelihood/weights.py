"""How much each sample of a replay counts: joint by joint and, where feet land, stretch by stretch.

Replays of a robot on legs are rough. A foot that lands a moment earlier sends a replay another way,
and what such a stretch errs by says little of the model. There each stretch counts by its own
error, and none errs by less than what replays of much the same robot differ by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Channels:
    """The samples (N, nv) of a replay; a channel is a joint in a part of them.

    Attributes:
        valid: samples that count, (N, nv) bool.
        parts: the samples in one part, or each stretch in its own.
        count: independent samples per joint, (nv,).
        floors: error of each channel that leaves nothing to explain, (parts, nv).
    """

    valid: Array
    parts: tuple[slice, ...]
    count: Array
    floors: Array

    @cached_property
    def sizes(self) -> Array:
        """Samples of each channel, (parts, nv)."""
        return self.sums(self.valid)

    @property
    def share(self) -> Array:
        """Share of each joint's samples that count as independent, (nv,)."""
        return np.asarray(self.count / np.maximum(self.sizes.sum(axis=0), 1))

    @property
    def floor(self) -> Array:
        """Error of a joint that leaves nothing to explain, (nv,): geometric over the parts."""
        return np.asarray(np.exp(np.log(self.floors).mean(axis=0)))

    def only(self, rows: Array) -> Channels:
        """With some of the samples, (N,) bool."""
        valid = self.valid & rows[:, None]
        return replace(self, valid=valid, count=self.share * valid.sum(axis=0))

    def rougher(self, apart: Sequence[Array]) -> Channels:
        """With higher floors, for what replays that ought to be alike are apart, (N, nv) each."""
        square = np.mean(np.square(apart), axis=0)
        return replace(self, floors=np.hypot(self.floors, np.sqrt(self.sums(square) / self._known)))

    def sums(self, values: Array) -> Array:
        """Sums over each channel, (parts, nv), of (N, nv)."""
        return np.stack([values[part].sum(axis=0) for part in self.parts])

    def variance(self, squares: Array) -> Array:
        """Mean of squares (parts, nv) or (parts · nv,), no less than what the right law leaves."""
        return np.asarray(
            np.maximum(squares.reshape(self.sizes.shape) / self._known, self.floors**2)
        )

    def nats(self, variance: Array) -> float:
        """Log-likelihood of errors with such variances (parts, nv), up to a constant."""
        return -0.5 * float((self.share * self.sizes * np.log(variance)).sum())

    def weights(self, variance: Array) -> Array:
        """With which the samples of each channel together count as its independent ones."""
        return np.asarray((self.share / variance).ravel())

    def precision(self, variance: Array) -> Array:
        """One over the variance of each sample, (N, nv)."""
        pairs = zip(self.parts, variance, strict=True)
        each = [np.broadcast_to(1.0 / v, self.valid[part].shape) for part, v in pairs]
        return np.concatenate(each)

    def rms(self, error: Array) -> Array:
        """Root mean square per joint, (nv,), of an error (N, nv) that is zero where unknown."""
        return np.asarray(np.sqrt((error**2).sum(axis=0) / np.maximum(self.sizes.sum(axis=0), 1)))

    @property
    def _known(self) -> Array:
        return np.maximum(self.sizes, 1)
