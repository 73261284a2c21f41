"""Weights of a replay's samples: joint by joint and, where feet land, stretch by stretch.

Replays of a robot on legs are rough. A foot that lands a moment earlier sends a replay another way,
and what such a stretch errs by says little of the model. There each stretch counts by its own
error, and none errs by less than what replays of much the same robot differ by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Num, Shaped


@dataclass(frozen=True, eq=False)
class Channels:
    """The samples of a replay; a channel is a joint in a part of them.

    Attributes:
        valid: samples that count.
        parts: the samples in one part, or each stretch in its own.
        count: independent samples per joint.
        floors: error of each channel that leaves nothing to explain.
    """

    valid: Bool[np.ndarray, "sample dof"]
    parts: tuple[slice, ...]
    count: Float[np.ndarray, " dof"]
    floors: Float[np.ndarray, "part dof"]

    @cached_property
    def sizes(self) -> Num[np.ndarray, "part dof"]:
        """Number of each channel's samples."""
        return self.sums(self.valid)

    @property
    def share(self) -> Float[np.ndarray, " dof"]:
        """Share of each joint's samples that count as independent."""
        return np.asarray(self.count / np.maximum(self.sizes.sum(axis=0), 1))

    @property
    def floor(self) -> Float[np.ndarray, " dof"]:
        """Error of a joint that leaves nothing to explain: geometric over the parts."""
        return np.asarray(np.exp(np.log(self.floors).mean(axis=0)))

    def only(self, rows: Bool[np.ndarray, " sample"]) -> Channels:
        """With some of the samples."""
        valid = self.valid & rows[:, None]
        return replace(self, valid=valid, count=self.share * valid.sum(axis=0))

    def each(self, parts: tuple[slice, ...]) -> Channels:
        """With other parts, each of which counts by its own error."""
        return replace(self, parts=parts, floors=np.tile(self.floor, (len(parts), 1)))

    def rougher(self, apart: Sequence[Float[np.ndarray, "sample dof"]]) -> Channels:
        """With higher floors, for what replays that ought to be alike are apart."""
        square = np.mean(np.square(apart), axis=0)
        return replace(self, floors=np.hypot(self.floors, np.sqrt(self.sums(square) / self._known)))

    def sums(self, values: Shaped[np.ndarray, "sample dof"]) -> Num[np.ndarray, "part dof"]:
        """Sums over each channel."""
        return np.stack([values[part].sum(axis=0) for part in self.parts])

    def variance(
        self, squares: Float[np.ndarray, "part dof"] | Float[np.ndarray, " channel"]
    ) -> Float[np.ndarray, "part dof"]:
        """Mean of each channel's sum of squares, no less than what the right law leaves."""
        return np.asarray(
            np.maximum(squares.reshape(self.sizes.shape) / self._known, self.floors**2)
        )

    def nats(self, variance: Float[np.ndarray, "part dof"]) -> float:
        """Log-likelihood of errors with such variances, up to a constant."""
        return -0.5 * float((self.share * self.sizes * np.log(variance)).sum())

    def weights(self, variance: Float[np.ndarray, "part dof"]) -> Float[np.ndarray, " channel"]:
        """Weights with which the samples of each channel together count as its independent ones."""
        return np.asarray((self.share / variance).ravel())

    def precision(self, variance: Float[np.ndarray, "part dof"]) -> Float[np.ndarray, "sample dof"]:
        """One over the variance of each sample."""
        pairs = zip(self.parts, variance, strict=True)
        each = [np.broadcast_to(1.0 / v, self.valid[part].shape) for part, v in pairs]
        return np.concatenate(each)

    def rms(self, error: Float[np.ndarray, "sample dof"]) -> Float[np.ndarray, " dof"]:
        """Root mean square per joint of an error that is zero where unknown."""
        return np.asarray(np.sqrt((error**2).sum(axis=0) / np.maximum(self.sizes.sum(axis=0), 1)))

    @property
    def _known(self) -> Num[np.ndarray, "part dof"]:
        return np.maximum(self.sizes, 1)
