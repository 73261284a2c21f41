"""Adaptation of initial states and tolerances, linear around where they were last found.

Two things that nobody would call a finding explain a part of any replay's error: the estimated
initial state of each stretch is uncertain, and every model has tolerances
(:mod:`wt.diagnose.likelihood.tolerances`). An error adapts many times over, each time with other
weights of its channels (a joint, or a joint in one stretch). Its products with its changes do not
depend on the weights, so that :class:`Squares` holds them once and for all.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from wt.diagnose.likelihood.bounded import NormalEquations
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

_IDLE = 0.01  # change of the weighted error, its standard deviation being one
_RIDGE = 1e-9  # of the squares
_AT_ONCE = 16  # errors that are read against changes at once, to bound memory


@dataclass(frozen=True, eq=False)
class Squares:
    """Products over the samples of each channel, of an error e and the changes C of it.

    Attributes:
        gram: CᵀC.
        right: Cᵀe.
        total: eᵀe.
    """

    gram: Float[np.ndarray, "channel change change"]
    right: Float[np.ndarray, "channel change"]
    total: Float[np.ndarray, " channel"]

    def only(self, kept: Int[np.ndarray, " kept"]) -> Squares:
        """With some of the changes, given by their indices."""
        return Squares(self.gram[:, kept[:, None], kept], self.right[:, kept], self.total)

    def left(self, x: Float[np.ndarray, " change"]) -> Float[np.ndarray, " channel"]:
        """Sum of squares of e + C x of each channel."""
        return np.maximum(self.total + (2.0 * self.right + self.gram @ x) @ x, 0.0)

    def step(
        self,
        weight: Float[np.ndarray, " channel"],
        low: Float[np.ndarray, " change"],
        high: Float[np.ndarray, " change"],
        prior: Float[np.ndarray, " change"],
        damping: Float[np.ndarray, " change"] | float = 0.0,
    ) -> Float[np.ndarray, " change"]:
        """The x within bounds that makes the weighted squares of e + C x least.

        Args:
            weight: of each channel's squares.
            low: smallest step.
            high: largest step.
            prior: weight of each parameter's own square; 1 for tolerances.
            damping: Levenberg-Marquardt, relative to the diagonal, of each or of all.
        """
        if not self.right.shape[1]:
            return np.zeros(0)
        normal = self._normal(weight, prior, damping)
        # what changes nothing within its bounds stays as it is
        idle = normal.scale * (high - low) < _IDLE
        return normal.active_set(np.where(idle, 0.0, low), np.where(idle, 0.0, high))

    def inside(
        self,
        weight: Float[np.ndarray, " channel"],
        box: Float[np.ndarray, " change"],
        near: Float[np.ndarray, " change"] | None = None,
    ) -> Float[np.ndarray, " change"]:
        """The x within ± box that makes the weighted squares of e + C x, and those of x, least.

        The squares of x keep the matrix far from singular.

        Args:
            weight: of each channel's squares.
            box: largest size of each.
            near: the x of other weights.
        """
        if not self.right.shape[1]:
            return np.zeros(0)
        x, free = np.zeros(len(box)), np.flatnonzero(box)
        normal = self.only(free)._normal(weight, np.ones(len(free)))
        x[free] = normal.pivoted(-box[free], box[free], None if near is None else near[free])
        return x

    def _normal(
        self,
        weight: Float[np.ndarray, " channel"],
        prior: Float[np.ndarray, " change"],
        damping: Float[np.ndarray, " change"] | float = 0.0,
    ) -> NormalEquations:
        n = self.right.shape[1]
        gram = (weight @ self.gram.reshape(len(weight), -1)).reshape(n, n)
        gram[range(n), range(n)] *= 1.0 + damping
        gram[range(n), range(n)] += prior
        return NormalEquations(gram, -(weight @ self.right), _RIDGE)


FARTHEST = 3.0
"""Most that an initial state adapts [deviations]: a window that wants more shows something else."""
REWEIGHTED = 4
"""Times that initial states adapt, each as far as what the last left of the error allows."""


@dataclass(frozen=True, eq=False)
class InitialState:
    """Changes of a stretch's replay by a plausible other initial state.

    Attributes:
        rows: of the stretch among all samples.
        response: to one deviation of each initial position and velocity.
        weighted: the same over the error's expected square, transposed.
        gram: products of both, and the prior's one deviation.
        farthest: most that it adapts [deviations].
    """

    rows: slice
    response: Float[np.ndarray, "error state"]
    weighted: Float[np.ndarray, "state error"]
    gram: Float[np.ndarray, "state state"]
    farthest: float

    @functools.cached_property
    def _solve(self) -> Float[np.ndarray, "state error"]:
        return np.asarray(np.linalg.solve(self.gram, self.weighted))

    def shift(self, error: Float[np.ndarray, " error"]) -> Float[np.ndarray, " state"]:
        """Deviations that explain most of an error, none beyond the farthest.

        What would go farther is held there, and the rest solved for once more.
        """
        wanted = np.asarray(self._solve @ error)
        at_limit = np.abs(wanted) > self.farthest
        if not at_limit.any():
            return wanted
        limited, free = np.clip(wanted, -self.farthest, self.farthest), ~at_limit
        if free.any():
            right = (
                self.weighted[free] @ error - self.gram[np.ix_(free, at_limit)] @ limited[at_limit]
            )
            limited[free] = np.linalg.solve(self.gram[np.ix_(free, free)], right)
        return np.clip(limited, -self.farthest, self.farthest)

    def change(
        self, error: Float[np.ndarray, " error"], changes: Float[np.ndarray, "error change"]
    ) -> Float[np.ndarray, "state change"]:
        """Deviations by which small changes of an error move :meth:`shift`, to first order.

        What is at its limit stays there.
        """
        free = np.abs(self._solve @ error) <= self.farthest
        moved = np.zeros((len(free), changes.shape[1]))
        moved[free] = np.linalg.solve(self.gram[np.ix_(free, free)], self.weighted[free] @ changes)
        return moved


def responses(
    replayer: Replayer, hypothesis: Sequence[Planted]
) -> Float[np.ndarray, "sample dof state"]:
    """Changes of replays by other initial states.

    Args:
        replayer: of the stretches.
        hypothesis: what is replayed; joints that it adds start with states of their own.

    Returns:
        The change per deviation of each position and velocity, those of added joints last.
    """
    stretches = replayer.stretches
    shifted = _shifted(replayer, tuple(hidden(hypothesis, stretches[0]).items()))
    q = shifted.run([hypothesis]).q[0]
    base, *moved = np.split(q, len(shifted.stretches) // len(stretches))
    return np.nan_to_num(np.stack([m - base for m in moved], axis=2))


@functools.lru_cache(maxsize=4)  # a proof comes back to those of its recordings
def _shifted(replayer: Replayer, added: tuple[tuple[str, tuple[float, float]], ...]) -> Replayer:
    """Replays from the initial states that are taken, and from each of the others.

    Args:
        replayer: of the stretches.
        added: deviations of the initial states of joints that a hypothesis adds, by name.
    """
    nv, stretches = replayer.scene.model.nv, replayer.stretches
    shifted = [
        replace(s, q0=s.q0 + (one * s.unsure)[:nv], v0=s.v0 + (one * s.unsure)[nv:])
        for one in (np.zeros(2 * nv), *np.eye(2 * nv))
        for s in stretches
    ]
    for name, (dq, dv) in added:
        shifted += [replace(s, shifts={name: (dq, 0.0)}) for s in stretches]
        shifted += [replace(s, shifts={name: (0.0, dv)}) for s in stretches]
    return Replayer(replayer.scene, shifted, replayer.step)


def hidden(hypothesis: Sequence[Planted], stretch: Stretch) -> dict[str, tuple[float, float]]:
    """Deviations of the initial states of joints that a hypothesis adds, where there are any."""
    deviations: dict[str, tuple[float, float]] = {}
    for p in hypothesis:
        started = p.started(stretch)
        deviations |= {n: state.unsure for n, state in started.items() if any(state.unsure)}
    return deviations


def initial_states(
    rows: Sequence[slice],
    response: Float[np.ndarray, "sample dof state"],
    mse: Float[np.ndarray, "*stretch dof"],
    farthest: float = FARTHEST,
) -> tuple[InitialState, ...]:
    """Prepare the projection of each stretch.

    Args:
        rows: of each stretch.
        response: of all samples to one deviation of each.
        mse: mean square error that a joint is expected to have, in all or in each stretch.
        farthest: most that a state adapts [deviations]. On legs it has no end: where their base
            was is estimated, by more than noise is known of.
    """
    states = []
    for own, expected in zip(rows, np.broadcast_to(mse, (len(rows), mse.shape[-1])), strict=True):
        s = response[own]
        n = s.shape[2]
        flat, w = s.reshape(-1, n), (s / expected[:, None]).reshape(-1, n)
        states.append(InitialState(own, flat, w.T, w.T @ flat + np.eye(n), farthest))
    return tuple(states)


def project(
    error: Float[np.ndarray, "sample dof"], initial: Sequence[InitialState]
) -> Float[np.ndarray, "sample dof"]:
    """Take out of an error of replays what plausible other initial states explain."""
    left = error.copy()
    for state in initial:
        part = error[state.rows]
        explained = state.response @ state.shift(part.reshape(-1))
        left[state.rows] -= explained.reshape(part.shape)
    return left


def project_changes(
    error: Float[np.ndarray, "sample dof"],
    changes: Float[np.ndarray, "sample dof change"],
    initial: Sequence[InitialState],
) -> Float[np.ndarray, "sample dof change"]:
    """Changes of a projected error by small ones of the error, to first order."""
    left, count = changes.copy(), changes.shape[2]
    for state in initial:
        part = changes[state.rows]
        moved = state.change(error[state.rows].reshape(-1), part.reshape(-1, count))
        left[state.rows] -= (state.response @ moved).reshape(part.shape)
    return left


@dataclass(frozen=True, eq=False)
class Adaptable:
    """Linearised errors of replays.

    Attributes:
        changes: of the projected error per deviation of each tolerance.
        centre: sizes of these that replays are run with unless others are given [deviations].
        parts: samples whose squares are summed apart.
        initial: of the stretches of a machine that does not forget its initial state.
    """

    changes: Float[np.ndarray, "dof sample tolerance"]
    centre: Float[np.ndarray, " tolerance"]
    parts: tuple[slice, ...]
    initial: tuple[InitialState, ...] = ()

    @property
    def columns(self) -> Float[np.ndarray, "sample dof tolerance"]:
        """The changes as columns of errors."""
        return self.changes.transpose(1, 0, 2)

    def moved(
        self, sizes: Float[np.ndarray, "*other tolerance"]
    ) -> Float[np.ndarray, "*other sample dof"]:
        """Change of the error by tolerances of such sizes [deviations]."""
        out = np.empty((*sizes.shape[:-1], *self.changes.shape[1::-1]))
        for dof, (acting, own) in enumerate(self._acting):
            out[..., dof] = sizes[..., acting] @ own.T
        return out

    def project(self, error: Float[np.ndarray, "sample dof"]) -> Float[np.ndarray, "sample dof"]:
        """Take out of an error what plausible other initial states explain."""
        return project(error, self.initial)

    def read(
        self,
        raw: Float[np.ndarray, "replay sample dof"],
        centres: Float[np.ndarray, "replay tolerance"],
    ) -> Iterator[tuple[Float[np.ndarray, "sample dof"], Squares | None]]:
        """What replays with tolerances of such sizes say of all other sizes.

        Args:
            raw: their errors.
            centres: of each [deviations].

        Yields:
            The error, projected, that each would have without tolerances, and its squares; None
            where it exploded.
        """
        for first in range(0, len(raw), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            projected = np.stack([self.project(e) for e in raw[some]])
            usual = (centres[some] == self.centre).all()
            errors = projected - (self._usual if usual else self.moved(centres[some]))
            known = np.isfinite(errors).all(axis=(1, 2))
            squares = self.squares(np.where(known[:, None, None], errors, 0.0))
            for error, one, finite in zip(errors, squares, known, strict=True):
                yield error, one if finite else None

    @functools.cached_property
    def _usual(self) -> Float[np.ndarray, "sample dof"]:
        """What tolerances change of nearly all errors."""
        return self.moved(self.centre)

    def squares(self, errors: Float[np.ndarray, "replay sample dof"]) -> list[Squares]:
        """Squares of errors that the tolerances change; part by part, joint by joint.

        Many errors at once are read against the changes as one product of matrices, which takes a
        fifth of the time of one after the other.
        """
        totals = [np.einsum("hij,hij->hj", *[errors[:, part]] * 2) for part in self.parts]
        total, right = np.concatenate(totals, axis=1), self._times(errors)
        return [Squares(self._gram, *each) for each in zip(right, total, strict=True)]

    def squares_beside(
        self,
        error: Float[np.ndarray, "sample dof"],
        jacobian: Float[np.ndarray, "sample dof parameter"],
    ) -> Squares:
        """Squares of an error that parameters, which come first, and the tolerances change.

        Args:
            error: of a replay, projected.
            jacobian: of the error in the parameters.
        """
        (own,) = self.squares(error[None])
        slopes, count = jacobian.transpose(1, 0, 2), jacobian.shape[2]
        beside = np.concatenate([error[:, :, None], jacobian], axis=2)
        products = [
            slopes[:, part].transpose(0, 2, 1) @ beside[part].transpose(1, 0, 2)
            for part in self.parts
        ]
        with_error, among = np.split(np.concatenate(products), [1], axis=2)
        across = self._times(np.moveaxis(jacobian, 2, 0)).transpose(1, 0, 2)
        gram = np.empty((len(own.gram), *[count + own.gram.shape[1]] * 2))
        gram[:, :count, :count], gram[:, :count, count:] = among, across
        gram[:, count:, :count], gram[:, count:, count:] = across.transpose(0, 2, 1), own.gram
        return Squares(gram, np.hstack([with_error[:, :, 0], own.right]), own.total)

    @functools.cached_property
    def _acting(
        self,
    ) -> tuple[tuple[Int[np.ndarray, " acting"], Float[np.ndarray, "sample acting"]], ...]:
        """Of each joint the tolerances that change it, and their changes.

        Of a robot's, most act on one limb.
        """
        acting = [np.flatnonzero(own.any(axis=0)) for own in self.changes]
        return tuple((k, own[:, k]) for k, own in zip(acting, self.changes, strict=True))

    @functools.cached_property
    def _gram(self) -> Float[np.ndarray, "channel tolerance tolerance"]:
        dofs, _, count = self.changes.shape
        gram = np.zeros((len(self.parts), dofs, count, count))
        for p, part in enumerate(self.parts):
            for dof, (acting, own) in enumerate(self._acting):
                gram[p, dof, acting[:, None], acting] = own[part].T @ own[part]
        return gram.reshape(-1, count, count)

    def _times(
        self, errors: Float[np.ndarray, "replay sample dof"]
    ) -> Float[np.ndarray, "replay channel tolerance"]:
        """Products of the changes and errors, channel by channel."""
        dofs, _, count = self.changes.shape
        times = np.zeros((len(errors), len(self.parts), dofs, count))
        for p, part in enumerate(self.parts):
            for dof, (acting, own) in enumerate(self._acting):
                times[:, p, dof, acting] = errors[:, part, dof] @ own[part]
        return times.reshape(len(errors), len(self.parts) * dofs, count)


def linear(
    changes: Float[np.ndarray, "tolerance sample dof"],
    centre: Float[np.ndarray, " tolerance"],
    parts: tuple[slice, ...],
    error: Float[np.ndarray, "sample dof"],
    initial: tuple[InitialState, ...] = (),
) -> Adaptable:
    """Project the changes of an error per deviation of each tolerance, to first order."""
    columns = np.moveaxis(changes, 0, 2)
    projected = project_changes(error, columns, initial).transpose(1, 0, 2)
    return Adaptable(np.ascontiguousarray(projected), centre, parts, initial)
