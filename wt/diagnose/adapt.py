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
from wt.physics.replay import Planted, Stretch
from wt.physics.rollout import Replayer

Array = np.ndarray

REWEIGHTED = 4
"""So often initial states adapt, each time as far as what the last left of the error allows."""
_IDLE = 0.01  # change of the weighted error, its standard deviation being one


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


def initial_deviations(noise: Array, velocity_noise: Array) -> Array:
    """Of a stretch's estimated initial positions and velocities, (2nv,), from the sensors'."""
    return np.concatenate([0.5 * np.nan_to_num(noise, nan=1.0), velocity_noise])


def responses(replayer: Replayer, hypothesis: Sequence[Planted], deviations: Array) -> Array:
    """What other initial states change in replays, (N, nv, 2nv).

    Args:
        replayer: of the stretches.
        hypothesis: what is replayed.
        deviations: of each initial position and velocity, (2nv,).
    """
    nv, stretches = len(deviations) // 2, replayer.stretches
    shifted = [
        Stretch(s.recording, s.t, s.held, s.q0 + shift[:nv], s.v0 + shift[nv:])
        for shift in (np.zeros(2 * nv), *np.diag(deviations))
        for s in stretches
    ]
    q = Replayer(replayer.scene, shifted, replayer.step).run([hypothesis]).q[0]
    base, *moved = np.split(q, 2 * nv + 1)
    return np.nan_to_num(np.stack([m - base for m in moved], axis=2))


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


def project(error: Array, initial: Sequence[InitialState]) -> Array:
    """Take out of an error (N, nv) what plausible other initial states explain."""
    if not initial:
        return error
    left = error.copy()
    for state in initial:
        part = error[state.rows]
        explained = state.response @ (state.solve @ part.reshape(-1))
        left[state.rows] -= explained.reshape(part.shape)
    return left


@dataclass(frozen=True, eq=False)
class Adaptable:
    """Linearised errors of replays.

    Attributes:
        columns: change of the projected error per deviation of each nuisance, (N, nv, n).
        centre: nuisances that replays are run with unless others are said, in deviations, (n,).
        initial: of the stretches of a machine that does not forget its initial state.
    """

    columns: Array
    centre: Array
    initial: tuple[InitialState, ...] = ()

    def project(self, error: Array) -> Array:
        """Take out of an error (N, nv) what plausible other initial states explain."""
        return project(error, self.initial)

    def at_origin(self, error: Array, centre: Array) -> Array:
        """What the error (N, nv) of a replay with some nuisances would be without, projected."""
        return np.asarray(self.project(error) - self.columns @ centre)


def linear(changes: Array, centre: Array, initial: tuple[InitialState, ...] = ()) -> Adaptable:
    """What adapts, from the changes of the error per deviation of each nuisance, (n, N, nv)."""
    columns = np.empty((*changes.shape[1:], len(changes)))
    for k, change in enumerate(changes):
        columns[:, :, k] = project(change, initial)
    return Adaptable(columns, centre, initial)


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
    # what changes nothing within its bounds stays as it is
    idle = scale * (high - low) < _IDLE
    low, high = np.where(idle, 0.0, low), np.where(idle, 0.0, high)
    scaled = gram / scale / scale[:, None] + 1e-9 * np.eye(n)
    root = np.linalg.cholesky(scaled)
    bounds = (low * scale - 1e-12, high * scale + 1e-12)
    target = np.linalg.solve(root, right / scale)
    # an active set: reflections from bounds stop short in the long valleys of a quiet sensor
    found = lsq_linear(root.T, target, bounds, method="bvls")
    return np.asarray(found.x) / scale


def box(count: int) -> Array:
    """Largest nuisances, in deviations, (count,)."""
    return np.full(count, BOX)
