"""Bounded least squares on what an error and its linear changes have in common.

An error is adapted many times over, each time with other weights of its channels: a joint, or a
joint in one stretch. Its products with the changes do not depend on the weights: they are made
once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

Array = np.ndarray

_IDLE = 0.01  # change of the weighted error, its standard deviation being one


@dataclass(frozen=True, eq=False)
class Squares:
    """Products over the samples of each of c channels, of an error e and the changes C of it.

    Attributes:
        gram: CᵀC, (c, n, n).
        right: Cᵀe, (c, n).
        total: eᵀe, (c,).
    """

    gram: Array
    right: Array
    total: Array

    def only(self, some: Array) -> Squares:
        """With some of the changes, given by their indices."""
        return Squares(self.gram[:, some[:, None], some], self.right[:, some], self.total)

    def left(self, x: Array) -> Array:
        """Sum of squares of e + C x of each channel, (c,)."""
        return np.maximum(self.total + (2.0 * self.right + self.gram @ x) @ x, 0.0)

    def step(
        self, weight: Array, low: Array, high: Array, prior: Array, damping: Array | float = 0.0
    ) -> Array:
        """The x within bounds that makes the weighted squares of e + C x least.

        Args:
            weight: of each channel's squares, (c,).
            low: smallest step, (n,).
            high: largest step, (n,).
            prior: weight of each parameter's own square, (n,); 1 for nuisances.
            damping: Levenberg-Marquardt, relative to the diagonal, of each, (n,), or of all.

        Returns:
            The step, (n,).
        """
        n = self.right.shape[1]
        if n == 0:
            return np.zeros(0)
        gram = (weight @ self.gram.reshape(len(weight), -1)).reshape(n, n)
        gram[range(n), range(n)] *= 1.0 + damping
        gram[range(n), range(n)] += prior
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        # what changes nothing within its bounds stays as it is
        idle = scale * (high - low) < _IDLE
        low, high = np.where(idle, 0.0, low), np.where(idle, 0.0, high)
        scaled = gram / scale / scale[:, None] + 1e-9 * np.eye(n)
        root = np.linalg.cholesky(scaled)
        bounds = (low * scale - 1e-12, high * scale + 1e-12)
        target = np.linalg.solve(root, -(weight @ self.right) / scale)
        # an active set: reflections from bounds stop short in the long valleys of a quiet sensor
        found = lsq_linear(root.T, target, bounds, method="bvls")
        return np.asarray(found.x) / scale
