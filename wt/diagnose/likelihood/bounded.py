"""Least squares inside a box, from the products of its columns.

Columns differ in size by many orders, from a mass to a time, so that every solver here works on
columns of length one. There are three, and each agrees with the others to some digits only, so
that none is exchanged for another without all results changing in their last ones:

- :meth:`NormalEquations.pivoted`, for the model's tolerances in their box, of thousands of
  hypotheses of the screen and of each replay. It moves many bounds at a time, and takes a fifth of
  the time of scipy's active set, which moves one (900 problems of 26 or of 33 unknowns);
- :meth:`NormalEquations.active_set`, scipy's, for the few steps of parameters, whose matrix is
  close to singular in the long valleys of a quiet sensor;
- :meth:`NormalEquations.reflected`, scipy's, for what adapts without a hypothesis.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

_ATTEMPTS, _PATIENCE = 200, 3  # at finding which unknowns stand at their bounds
_SLACK = 1e-9
_CLOSE = 1e-4  # share of its range that an unknown is from a bound where it begins there
_MARGIN = 1e-12  # scipy's active set wants room between the bounds


class NormalEquations:
    """Minimise ½ xᵀ G x − xᵀ r, with every column scaled to length one and a ridge added.

    Attributes:
        scale: length of each column.
        gram: G, scaled, with the ridge.
        right: r, scaled.
    """

    def __init__(
        self,
        gram: Float[np.ndarray, "unknown unknown"],
        right: Float[np.ndarray, " unknown"],
        ridge: float,
    ) -> None:
        """Scale.

        Args:
            gram: products of the columns with each other.
            right: products of the columns with the target.
            ridge: added to the diagonal once that is one.
        """
        self.scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        self.gram = gram / self.scale / self.scale[:, None] + ridge * np.eye(len(gram))
        self.right = right / self.scale

    @cached_property
    def _root(self) -> Float[np.ndarray, "unknown unknown"]:
        """Lower triangle L with L Lᵀ = G."""
        return np.linalg.cholesky(self.gram)

    def active_set(
        self, low: Float[np.ndarray, " unknown"], high: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, " unknown"]:
        """Solve by one bound at a time (P. Stark and R. Parker, 1995).

        Reflections from bounds stop short in long valleys; this does not.
        """
        wide = self._scipy(low * self.scale - _MARGIN, high * self.scale + _MARGIN, "bvls")
        return np.clip(wide, low, high)  # where a column is nothing, the margin is any number

    def reflected(
        self, low: Float[np.ndarray, " unknown"], high: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, " unknown"]:
        """Solve by reflections from the bounds (M. Branch, T. Coleman and Y. Li, 1999)."""
        return self._scipy(low * self.scale, high * self.scale, "trf")

    def _scipy(
        self,
        low: Float[np.ndarray, " unknown"],
        high: Float[np.ndarray, " unknown"],
        method: str,
    ) -> Float[np.ndarray, " unknown"]:
        # |Lᵀ x − L⁻¹ r|² is the function to minimise, up to a constant
        target = np.linalg.solve(self._root, self.right)
        return np.asarray(
            lsq_linear(self._root.T, target, (low, high), method=method).x / self.scale
        )

    def pivoted(
        self,
        low: Float[np.ndarray, " unknown"],
        high: Float[np.ndarray, " unknown"],
        near: Float[np.ndarray, " unknown"] | None = None,
    ) -> Float[np.ndarray, " unknown"]:
        """Solve by block principal pivoting (L. Portugal, J. Júdice and L. Vicente, 1994).

        What would leave the box is held at its bound, what pulls inwards is let go again: all at a
        time while that makes fewer of them, else one at a time; by the active set if that goes in
        circles. What has no room is never let go.

        Args:
            low: smallest values.
            high: largest values.
            near: a solution of a problem close by: what stands at its bounds there is held first.
        """
        gram, right, lower, upper = self.gram, self.right, low * self.scale, high * self.scale
        loose = lower < upper
        x, free = np.where(loose, 0.0, lower), loose.copy()
        if near is not None:
            x = np.clip(near * self.scale, lower, upper)
            close = np.where(np.isfinite(upper - lower), _CLOSE * (upper - lower), 0.0)
            x = np.where(x - lower <= close, lower, np.where(upper - x <= close, upper, x))
            free &= (lower < x) & (x < upper)
        fewest, patience = len(gram) + 1, _PATIENCE
        for _ in range(_ATTEMPTS):
            loosened, held = np.flatnonzero(free), np.flatnonzero(~free)
            rows = loosened[:, None]
            at_bound = gram[rows, held] @ x[held]
            x[loosened] = np.linalg.solve(gram[rows, loosened], right[loosened] - at_bound)
            pull = right - gram @ x
            outside = free & ((x < lower) | (x > upper))
            inwards = loose & ~free & np.where(x <= lower, pull > _SLACK, pull < -_SLACK)
            wrong = np.flatnonzero(outside | inwards)
            if not len(wrong):
                return np.asarray(x / self.scale)
            if len(wrong) < fewest:
                fewest, patience = len(wrong), _PATIENCE
            elif patience:
                patience -= 1
            else:
                wrong = wrong[-1:]
            free[wrong] = ~free[wrong]
            x[~free] = np.clip(x[~free], lower[~free], upper[~free])
        return self.active_set(low, high)
