"""Adaptation of initial states and tolerances, linear around where they were last found.

Two things that nobody would call a finding explain a part of any replay's error: the estimated
initial state of each stretch is uncertain, and every model has tolerances
(:mod:`wt.diagnose.likelihood.tolerances`). An error adapts many times over, each time with other
weights of its channels (a joint, or a joint in one stretch). Its products with its changes do not
depend on the weights, so that :class:`Squares` holds them once and for all.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

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


REWEIGHTED = 4
"""So often initial states adapt, each time as far as what the last left of the error allows."""


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
    """What other initial states change in replays, (N, nv, m).

    Args:
        replayer: of the stretches.
        hypothesis: what is replayed; joints that it adds start with states of their own.
        deviations: of each initial position and velocity, (2nv,).

    Returns:
        The change per deviation of each position and velocity, those of added joints last.
    """
    nv, stretches = len(deviations) // 2, replayer.stretches
    shifted = [
        replace(s, q0=s.q0 + shift[:nv], v0=s.v0 + shift[nv:])
        for shift in (np.zeros(2 * nv), *np.diag(deviations))
        for s in stretches
    ]
    for name, (dq, dv) in hidden(hypothesis, stretches[0]).items():
        shifted += [replace(s, shifts={name: (dq, 0.0)}) for s in stretches]
        shifted += [replace(s, shifts={name: (0.0, dv)}) for s in stretches]
    q = Replayer(replayer.scene, shifted, replayer.step).run([hypothesis]).q[0]
    base, *moved = np.split(q, len(shifted) // len(stretches))
    return np.nan_to_num(np.stack([m - base for m in moved], axis=2))


def hidden(hypothesis: Sequence[Planted], stretch: Stretch) -> dict[str, tuple[float, float]]:
    """Deviations of the initial states of joints that a hypothesis adds, where there are any."""
    found: dict[str, tuple[float, float]] = {}
    for p in hypothesis:
        started = p.started(stretch)
        found |= {name: state.unsure for name, state in started.items() if any(state.unsure)}
    return found


def initial_states(rows: Sequence[slice], response: Array, mse: Array) -> tuple[InitialState, ...]:
    """Prepare the projection of each stretch.

    Args:
        rows: of each stretch.
        response: of all samples to one deviation of each, (N, nv, 2nv).
        mse: mean square error that a joint is expected to have, (nv,) or (stretches, nv).
    """
    found = []
    for some, expected in zip(rows, np.broadcast_to(mse, (len(rows), mse.shape[-1])), strict=True):
        s = response[some]
        n = s.shape[2]
        flat, w = s.reshape(-1, n), (s / expected[:, None]).reshape(-1, n)
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
        changes: of the projected error per deviation of each nuisance, (nv, N, n).
        centre: nuisances that replays are run with unless others are said, in deviations, (n,).
        parts: samples whose squares are summed apart.
        initial: of the stretches of a machine that does not forget its initial state.
    """

    changes: Array
    centre: Array
    parts: tuple[slice, ...]
    initial: tuple[InitialState, ...] = ()

    @property
    def columns(self) -> Array:
        """The changes as columns of errors, (N, nv, n)."""
        return self.changes.transpose(1, 0, 2)

    def moved(self, nuisance: Array) -> Array:
        """What so many deviations of each nuisance change in the error, (N, nv)."""
        return np.asarray((self.changes @ nuisance).T)

    def project(self, error: Array) -> Array:
        """Take out of an error (N, nv) what plausible other initial states explain."""
        return project(error, self.initial)

    def at_origin(self, error: Array, centre: Array) -> Array:
        """What the error (N, nv) of a replay with some nuisances would be without, projected."""
        return np.asarray(self.project(error) - self.moved(centre))

    def squares(self, error: Array) -> Squares:
        """Of an error (N, nv) that the nuisances change; part by part, joint by joint."""
        total = [np.einsum("ij,ij->j", error[part], error[part]) for part in self.parts]
        return Squares(self._gram, self._times(self.changes, error), np.concatenate(total))

    def squares_beside(self, error: Array, jacobian: Array) -> Squares:
        """Of an error (N, nv) that p parameters, which come first, and the nuisances change.

        Args:
            error: (N, nv).
            jacobian: of the error in the parameters, (N, nv, p).
        """
        own, some = self.squares(error), np.ascontiguousarray(jacobian.transpose(1, 0, 2))
        among, across = self._products(some, some), self._products(some, self.changes)
        gram = np.block([[among, across], [across.transpose(0, 2, 1), own.gram]])
        return Squares(gram, np.hstack([self._times(some, error), own.right]), own.total)

    @functools.cached_property
    def _gram(self) -> Array:
        return self._products(self.changes, self.changes)

    def _products(self, some: Array, others: Array) -> Array:
        """Products of changes (nv, N, m) and (nv, N, n), (parts · nv, m, n)."""
        each = [some[:, part].transpose(0, 2, 1) @ others[:, part] for part in self.parts]
        return np.concatenate(each)

    def _times(self, changes: Array, error: Array) -> Array:
        """Products of changes (nv, N, n) and an error (N, nv), (parts · nv, n)."""
        each = [(error[part].T[:, None, :] @ changes[:, part])[:, 0] for part in self.parts]
        return np.concatenate(each)


def linear(
    changes: Array,
    centre: Array,
    parts: tuple[slice, ...],
    initial: tuple[InitialState, ...] = (),
) -> Adaptable:
    """What adapts, from the changes of the error per deviation of each nuisance, (n, N, nv)."""
    n, samples, nv = changes.shape
    projected = np.empty((nv, samples, n))
    for k, change in enumerate(changes):
        projected[:, :, k] = project(change, initial).T
    return Adaptable(projected, centre, parts, initial)
