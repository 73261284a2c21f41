"""Directions of a vector parameter that the recordings show, and those that they cannot.

A planar arm says nothing of how far beside its plane a tether is anchored, a hinge nothing of a
centre of mass along its axis, a rail nothing of a force across it. Fitted all the same, such a
direction follows the rounding of its replays to a bound. It is not fitted: it stays where the
effect is nothing or, where there is no such value, where it began.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Planted

_ALONG = 1e-6
"""Share of an axis' square in what is shown, below which nothing of it is."""


def shown(
    parts: Sequence[Planted],
    slope: Float[np.ndarray, "sample dof parameter"],
    precision: Float[np.ndarray, "sample dof"],
) -> Float[np.ndarray, "parameter parameter"]:
    """Projector of parameters to the directions that replays depend on.

    Only directions of one vector are compared with each other: they have one unit.

    Args:
        parts: whose parameters they are, one after another.
        slope: of the error in them.
        precision: one over the variance of each sample.
    """
    projector = np.eye(slope.shape[2])
    for _, rows in _vectors(parts):
        own = (slope[:, :, rows] * np.sqrt(precision)[:, :, None]).reshape(
            -1, rows.stop - rows.start
        )
        squares, directions = np.linalg.eigh(own.T @ own)
        kept = directions[:, squares > THRESHOLDS.shown**2 * squares[-1]]
        kept[~own.any(axis=0)] = 0.0  # an axis that changes nothing has no share in any, to the bit
        if kept.size:  # nothing of a spring without stiffness shows where it is tied to
            projector[rows, rows] = kept @ kept.T
    return projector


def without_hidden(
    parts: Sequence[Planted],
    theta: Float[np.ndarray, " parameter"],
    projector: Float[np.ndarray, "parameter parameter"],
) -> Float[np.ndarray, " parameter"]:
    """Parameters of which what is not shown is nothing, wherever that has a value."""
    there = theta.copy()
    for neutral, rows in _vectors(parts):
        if neutral is not None:
            there[rows] = neutral + projector[rows, rows] @ (theta[rows] - neutral)
    return there


def hidden_axes(
    projector: Float[np.ndarray, "component component"],
) -> list[int]:
    """Components of one vector of which nothing is shown.

    Where what is not shown lies across the axes, each of them shows a part.
    """
    return [int(i) for i in np.flatnonzero(np.diag(projector) < _ALONG)]


def _vectors(parts: Sequence[Planted]) -> list[tuple[float | None, slice]]:
    """Neutral value and place among the parameters of every vector."""
    vectors, start = [], 0
    for planted in parts:
        for p in planted.effect.parameters:
            if p.size > 1:
                vectors.append((p.neutral, slice(start, start + p.size)))
            start += p.size
    return vectors
