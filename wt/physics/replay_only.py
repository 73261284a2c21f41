"""Effects that no force tells: only a replay of the patched model does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Shape
from wt.physics.motion import Motion
from wt.types import Location


class ReplayOnly(Effect):
    """Base of effects without a signature; :meth:`Effect.starts` says where replays begin."""

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """None: there is no signature."""
        return []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Nothing, (T, nv, 0)."""
        return np.zeros((*motion.q.shape, 0))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Nothing: there is no coefficient that would tell."""
        return np.zeros(self.n_theta)
