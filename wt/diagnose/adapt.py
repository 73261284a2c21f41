"""What may adapt beside a hypothesis, linear around where it was last found.

Two things that nobody would call a finding explain a part of any replay's error: the estimated
initial state of each stretch is uncertain, and any rig is off by a little
(:mod:`wt.diagnose.nuisance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from wt.diagnose.nuisance import BOX

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class InitialState:
    """What a plausible other initial state changes in a stretch's replay, K samples.

    Attributes:
        rows: of the stretch among all samples.
        response: to one deviation of each initial position and velocity, (K·nv, 2nv).
        solve: ridge solution for the deviations, (2nv, K·nv).
    """

    rows: slice
    response: Array
    solve: Array


def initial_states(rows: Sequence[slice], response: Array, mse: Array) -> tuple[InitialState, ...]:
    """Prepare the projection of each stretch.

    Args:
        rows: of each stretch.
        response: of all samples to one deviation of each, (N, nv, 2nv).
        mse: mean square error that a joint is expected to have, (nv,).
    """
    found = []
    for some in rows:
        s = response[some]
        n = s.shape[2]
        flat, w = s.reshape(-1, n), (s / mse[:, None]).reshape(-1, n)
        found.append(InitialState(some, flat, np.linalg.solve(w.T @ flat + np.eye(n), w.T)))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Adaptable:
    """Linearised errors of replays.

    Attributes:
        columns: change of the projected error per deviation of each nuisance, (N, nv, n).
        centre: nuisances that replays are run with, in deviations, (n,).
        initial: of the stretches of a machine that does not forget its initial state.
    """

    columns: Array
    centre: Array
    initial: tuple[InitialState, ...] = ()

    def project(self, error: Array) -> Array:
        """Take out of an error (N, nv) what a plausible other initial state explains."""
        if not self.initial:
            return error
        left = error.copy()
        for state in self.initial:
            part = error[state.rows]
            explained = state.response @ (state.solve @ part.reshape(-1))
            left[state.rows] -= explained.reshape(part.shape)
        return left

    def at_origin(self, error: Array) -> Array:
        """The projected error (N, nv) that a replay without any nuisance would have."""
        return np.asarray(self.project(error) - self.columns @ self.centre)


def bounded_step(
    error: Array,
    columns: Array,
    weight: Array,
    low: Array,
    high: Array,
    prior: Array,
    damping: float = 0.0,
) -> Array:
    """Bounded least squares that removes an error.

    Args:
        error: (N, nv).
        columns: what the error changes by per unit of each parameter, (N, nv, n).
        weight: of each joint's squares, (nv,).
        low: smallest step, (n,).
        high: largest step, (n,).
        prior: weight of each parameter's own square, (n,); 1 for nuisances, 0 for others.
        damping: Levenberg-Marquardt, relative to the diagonal, where the prior is 0.

    Returns:
        The step, (n,).
    """
    n = columns.shape[2]
    if n == 0:
        return np.zeros(0)
    flat = columns.reshape(-1, n)
    weighted = (columns * weight[:, None]).reshape(-1, n)
    gram = flat.T @ weighted
    gram[range(n), range(n)] *= np.where(prior > 0.0, 1.0, 1.0 + damping)
    gram[range(n), range(n)] += prior
    right = -weighted.T @ error.reshape(-1)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / scale / scale[:, None] + 1e-9 * np.eye(n)
    root = np.linalg.cholesky(scaled)
    bounds = (low * scale - 1e-12, high * scale + 1e-12)
    found = lsq_linear(root.T, np.linalg.solve(root, right / scale), bounds)
    return np.asarray(found.x) / scale


def box(count: int) -> Array:
    """Largest nuisances, in deviations, (count,)."""
    return np.full(count, BOX)
