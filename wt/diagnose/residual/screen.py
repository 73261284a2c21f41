"""Thousands of hypotheses compared on the force residual: which effect, where, how large.

The residual (inverse dynamics minus drive forces) and the signature of every hypothesis pass the
same smooth window, the weak form, so that noise of accelerations averages out. A hypothesis is
scored by the log-likelihood it gains once everything else is free to adapt: the effects accepted
so far, and the model's tolerances inside their box.
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize

from wt.diagnose.likelihood.tolerances import forces, tolerances
from wt.diagnose.recordings.smooth import Smoothed, resmooth
from wt.diagnose.residual.scoring import STRIDE, WINDOW, FreeFit, Signature, bounded, boxed
from wt.diagnose.residual.signature import reduced, signature
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Effect, Shape, effects
from wt.physics.hooks import FromRecordings, around, n_fitted
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location

REFINED = 20
"""Best hypotheses that get their shapes polished."""
RELINEARISED = 12
"""… and steps that are taken where a signature is linear around its shape only."""
_SHORTER, _CONVERGED = (1.0, 0.5, 0.25, 0.1), 0.1  # of a step; nats that it gains
_PASSED_ON = 0.03  # of a signature's largest part: what is smaller is left out
_ALIKE = 0.1  # of a residual: what has changed by less is read alike
_EDGE = 3  # windows left out at either end of a segment, where a spline is loose


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis with its score.

    Attributes:
        planted: effect, place and parameters estimated from the force residual.
        shape: the shape its signature was computed with.
        gain: log-likelihood gained, less the price of its parameters [nats].
    """

    planted: Planted
    shape: Shape
    gain: float


class Pair(NamedTuple):
    """Two hypotheses together.

    Attributes:
        gain: log-likelihood gained, less the price of all parameters [nats].
        first: one of them.
        second: the other.
    """

    gain: float
    first: Planted
    second: Planted


class Screen:
    """The weak force residual of some recordings and what can explain it.

    Attributes:
        motion: the smoothed recordings.
        residual: weak residual [N·m].
        floor: standard deviation that measurement noise alone gives it [N·m].
        rows: for each row, the sample at the window's centre.
        keep: rows that count for each degree of freedom: moving, unless that drops most, and not
            while a foot lands.
        tolerances: of the model.
        tolerance_forces: weak force of one deviation of each [N·m].
    """

    def __init__(self, smoothed: Smoothed, seed: int = 0) -> None:
        """Compute residual, noise floor and the tolerances' columns."""
        self.motion = smoothed.motion
        self.rows = _centres(self.motion)
        self.residual = self.weak(self.motion.unexplained)
        rng = np.random.default_rng(seed)
        renewed = resmooth(smoothed, rng)
        self.floor = np.std(self.weak_force(renewed.residual - self.motion.residual), axis=0)
        self.floor = np.maximum(self.floor, 1e-6 * np.std(self.motion.demand, axis=0) + 1e-300)
        self.keep = _fast_enough(self.motion, self.rows)
        self.tolerances = tolerances(self.motion.scene)
        small = forces(self.motion, self.tolerances)
        self.tolerance_forces = np.stack([self.weak_force(f) for f in small], axis=2)
        self._cache: dict[tuple[str, Location], list[Signature]] = {}
        self._read: dict[
            tuple[str, Location], tuple[Float[np.ndarray, "sample acted"], Sequence[Shape]]
        ] = {}

    def weak_force(
        self, force: Float[np.ndarray, "sample dof *column"]
    ) -> Float[np.ndarray, "row dof *column"]:
        """Weak form of the free part of a generalised force."""
        return self.weak(self.motion.touching.free(force))

    def weak(
        self, signal: Float[np.ndarray, " sample *column"]
    ) -> Float[np.ndarray, " row *column"]:
        """Weak form of a signal."""
        kernel = _kernel()
        half = WINDOW // 2
        out = np.zeros((len(self.rows), *signal.shape[1:]))
        for k, weight in enumerate(kernel):
            out += weight * signal[self.rows + k - half]
        return out

    def rank(
        self,
        accepted: Sequence[tuple[Planted, Shape | None]],
        only: Container[tuple[str, Location]] | None = None,
    ) -> list[Scored]:
        """Effects at places, best shape each, by falling gain.

        Args:
            accepted: effects found already, with the shape of their signature; they stay free.
            only: ids and places that are ranked; every effect at every place if left out.
        """
        free = FreeFit(self, [self._accepted(p, s) for p, s in accepted if s is not None])
        rest = reduced(self.motion, [p for p, _ in accepted])
        taken = {p.key for p, _ in accepted}
        scored: list[Scored] = []
        for effect in effects().values():
            for at in effect.places(self.motion.scene):
                wanted = only is None or (effect.id, at) in only
                if not wanted or (effect.id, at.kind, at.name) in taken:
                    continue
                options = [_scored(free, s) for s in self._signatures(effect, at, rest)]
                if options:
                    scored.append(max(options, key=lambda s: s.gain))
        scored.sort(key=lambda s: -s.gain)
        promising = sum(s.gain > 0.0 for s in scored[:REFINED])
        best = [self._polished(free, s) for s in scored[:promising]]
        return sorted(best + scored[promising:], key=lambda s: -s.gain)

    def pairs(
        self,
        accepted: Sequence[tuple[Planted, Shape | None]],
        groups: Sequence[Sequence[Scored]],
    ) -> list[list[Pair]]:
        """Two hypotheses of a group together, by falling gain.

        Args:
            accepted: effects found already, as in :meth:`rank`.
            groups: hypotheses, with their shapes.

        Returns:
            The pairs of each group.
        """
        free = FreeFit(self, [self._accepted(p, s) for p, s in accepted if s is not None])
        ranked = []
        for group in groups:
            signatures = [self._signature(s.planted.effect, s.planted.at, s.shape) for s in group]
            fits = [free.fit(one, other) for one, other in itertools.combinations(signatures, 2)]
            pairs = [Pair(gain, *planted) for gain, planted in fits]
            ranked.append(sorted(pairs, key=lambda p: -p.gain))
        return ranked

    def _signatures(self, effect: Effect, at: Location, rest: Motion) -> list[Signature]:
        """Signatures of an effect, those that read the residual from what is left of it."""
        key = (effect.id, at)
        if isinstance(effect, FromRecordings) and effect.reads_residual:
            return [self._signature(effect, at, s, rest) for s in self._read_off(effect, at, rest)]
        if key not in self._cache:
            shapes = effect.shapes(self.motion, at)
            self._cache[key] = [self._signature(effect, at, s) for s in shapes]
        return self._cache[key]

    def _read_off(self, effect: Effect, at: Location, rest: Motion) -> Sequence[Shape]:
        """Shapes that an effect reads off what is left of the residual.

        They are where its figures start from: what was read before will do, where what is left on
        the joints that it acts on has hardly changed.
        """
        key, dofs = (effect.id, at), sorted(self.motion.scene.dofs_at(at))
        left = rest.unexplained[:, dofs]
        known = self._read.get(key)
        if known is None or np.linalg.norm(left - known[0]) > _ALIKE * np.linalg.norm(known[0]):
            known = self._read[key] = left, effect.shapes(rest, at)
        return known[1]

    def _signature(
        self, effect: Effect, at: Location, shape: Shape, motion: Motion | None = None
    ) -> Signature:
        weak = self.weak_force(effect.columns(motion or self.motion, at, shape))
        size = np.abs(weak).max(axis=(0, 2), initial=0.0) / self.floor
        # a contact passes a little of every force on to all joints
        passed_on = _PASSED_ON if self.motion.touching.near.any() else 0.0
        dofs = np.flatnonzero(size > passed_on * size.max())
        return Signature(effect, at, shape, dofs, weak[:, dofs])

    def _accepted(self, planted: Planted, shape: Shape) -> Float[np.ndarray, "row dof coefficient"]:
        signature = self._signature(planted.effect, planted.at, shape)
        return signature.on(range(self.motion.q.shape[1]))

    def _polished(self, free: FreeFit, scored: Scored) -> Scored:
        """A hypothesis with its shape improved: by Nelder-Mead, or where it is linear only."""
        effect, at = scored.planted.effect, scored.planted.at
        if around(effect, scored.planted.theta) is not None:
            return self._relinearised(free, scored)
        fitted = n_fitted(effect, scored.shape)
        shape = np.array(scored.shape[:fitted])
        if not shape.size or not (shape > 0.0).all():
            return scored

        def trial(log_shape: Float[np.ndarray, " shape"]) -> Scored:
            tried = tuple(float(x) for x in np.exp(log_shape))
            return _scored(free, self._signature(effect, at, (*tried, *scored.shape[fitted:])))

        spread = np.vstack([np.log(shape), np.log(shape) + 0.25 * np.eye(shape.size)])
        best = minimize(
            lambda log_shape: -trial(log_shape).gain,
            np.log(shape),
            method="Nelder-Mead",
            options={"maxfev": 18 * shape.size, "initial_simplex": spread, "fatol": 0.3},
        )
        return max(scored, trial(best.x), key=lambda s: s.gain)

    def _relinearised(self, free: FreeFit, scored: Scored) -> Scored:
        """A hypothesis that is linear around its shape only, with the force it has around the best.

        Gauss-Newton, each step as long as the force gains that the shape alone stands for: what is
        linear around a shape too far away is the force of no such thing.
        """
        effect, at, shape = scored.planted.effect, scored.planted.at, scored.shape
        best = _scored(free, self._signature(effect, at, shape).alone)
        for _ in range(RELINEARISED):
            nearby = _scored(free, self._signature(effect, at, best.shape))
            here, there = np.array(best.shape), around(effect, nearby.planted.theta)
            shapes = [tuple((here + share * (there - here)).tolist()) for share in _SHORTER]
            trials = [_scored(free, self._signature(effect, at, s).alone) for s in shapes]
            step = max(trials, key=lambda s: s.gain)
            if step.gain <= best.gain + _CONVERGED:
                break
            best = step
        return best


def _scored(free: FreeFit, signature: Signature) -> Scored:
    gain, (planted,) = free.fit(signature)
    return Scored(planted, signature.shape, gain)


def _kernel() -> Float[np.ndarray, " window"]:
    kernel = np.cos(np.linspace(-np.pi / 2, np.pi / 2, WINDOW + 2)[1:-1]) ** 2
    return np.asarray(kernel / kernel.sum())


def _centres(motion: Motion) -> Int[np.ndarray, " row"]:
    half = WINDOW // 2 + _EDGE
    rows = [np.arange(s.rows.start + half, s.rows.stop - half, STRIDE) for s in motion.segments]
    return np.concatenate(rows)


def _fast_enough(motion: Motion, rows: Int[np.ndarray, " row"]) -> Bool[np.ndarray, "row dof"]:
    """Rows that count for each degree of freedom: moving, unless that drops most; calm."""
    keep = np.abs(motion.v[rows]) > THRESHOLDS.slow
    keep[:, keep.mean(axis=0) < 0.5] = True
    return np.asarray(keep & motion.calm[rows, None])


@dataclass(frozen=True, eq=False)
class Leftover:
    """The weak force residual, taken apart.

    Attributes:
        left: what nothing explains [N·m].
        adapted: what the tolerances explain [N·m].
        parts: force of each effect of the hypothesis [N·m]; zero where an effect has no signature
            in forces.
        keep: rows that count for each degree of freedom: moving, unless that drops most.
    """

    left: Float[np.ndarray, "row dof"]
    adapted: Float[np.ndarray, "row dof"]
    parts: tuple[Float[np.ndarray, "row dof"], ...]
    keep: Bool[np.ndarray, "row dof"]

    def without(self, index: int) -> Float[np.ndarray, "row dof"]:
        """The residual that is left if one of the effects is taken back [N·m]."""
        return np.asarray(self.left + self.parts[index])


def leftover(screen: Screen, hypothesis: Hypothesis) -> Leftover:
    """Fit the signatures of a hypothesis and the bounded tolerances to the weak residual."""
    signatures = [signature(screen.motion, p) for p in hypothesis]
    free = [screen.weak_force(s) for s in signatures if s is not None]
    columns = np.concatenate([*free, screen.tolerance_forces], axis=2)
    bound, keep = boxed(columns, screen), screen.keep
    x = np.zeros(columns.shape[2])
    mse = np.mean(screen.residual**2, axis=0)
    for _ in range(3):
        x = bounded(columns, screen.residual, keep / np.maximum(mse, screen.floor**2), bound)
        left = screen.residual - columns @ x
        mse = (keep * left**2).sum(axis=0) / np.maximum(keep.sum(axis=0), 1)
    parts, start = [], 0
    for s in signatures:
        size = 0 if s is None else s.shape[2]
        parts.append(columns[:, :, start : start + size] @ x[start : start + size])
        start += size
    adapted = columns[:, :, start:] @ x[start:]
    return Leftover(screen.residual - columns @ x, adapted, tuple(parts), keep)
