"""Effects that no force tells: only a replay of the patched model does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wt.physics.effect import Effect, Shape
from wt.physics.motion import Motion
from wt.types import Location

Array = np.ndarray


class ReplayOnly(Effect):
    """Base of effects without a signature; :meth:`Effect.starts` says where replays begin."""

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """None: there is no signature."""
        return []

    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """Nothing, (T, nv, 0)."""
        return np.zeros((*motion.q.shape, 0))

    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """Nothing: there is no coefficient that would tell."""
        return np.zeros(self.n_theta)
