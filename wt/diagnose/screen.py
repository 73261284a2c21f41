"""Thousands of hypotheses compared on the force residual: which effect, where, how large.

The residual (inverse dynamics minus drive forces) and the signature of every hypothesis pass the
same smooth window, the weak form, so that noise of accelerations averages out. A hypothesis is
scored by the log-likelihood it gains once everything else is free to adapt: the effects accepted
so far, and what any rig is off by inside its box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear, minimize

from wt.diagnose.nuisance import BOX, forces, nuisances
from wt.diagnose.smooth import Smoothed, resmooth
from wt.physics.effect import Effect, Shape, effects
from wt.physics.motion import Motion
from wt.physics.replay import Planted
from wt.types import Location

Array = np.ndarray

WINDOW, STRIDE = 13, 5
"""Length and spacing of the weak form's cos² windows, in samples."""
SLOW = 0.05
"""Below this speed [rad/s] presliding decides friction, and a row is left out."""
REFINED = 30
"""So many of the best hypotheses get their shapes polished."""
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


@dataclass(frozen=True, eq=False)
class _Block:
    effect: Effect
    at: Location
    shape: Shape
    columns: Array  # (R, nv, k), filtered


class Screen:
    """The weak force residual of some recordings and what can explain it.

    Attributes:
        motion: the smoothed recordings.
        residual: weak residual, (R, nv) [N·m].
        floor: what measurement noise alone makes of it, (nv,) [N·m].
        rows: for each of the R rows, the sample at the window's centre.
        keep: rows that count for each degree of freedom: moving, unless that drops most, (R, nv).
        nuisance: weak force of the errors of any rig, one deviation each, (R, nv, n) [N·m].
        velocity_noise: uncertainty of the smoothed velocity, (nv,) [rad/s].
    """

    def __init__(self, smoothed: Smoothed, seed: int = 0) -> None:
        """Compute residual, noise floor and the nuisance columns."""
        self.motion = smoothed.motion
        self.rows = _centres(self.motion)
        self.residual = self.weak(self.motion.residual)
        rng = np.random.default_rng(seed)
        renewed = resmooth(smoothed, rng)
        self.floor = np.std(self.weak(renewed.residual - self.motion.residual), axis=0)
        self.floor = np.maximum(self.floor, 1e-6 * (np.std(self.motion.demand, axis=0) + 1e-3))
        self.keep = _fast_enough(self.motion, self.rows)
        small = forces(self.motion, nuisances(self.motion.scene))
        self.nuisance = np.stack([self.weak(f) for f in small], axis=2)
        self.velocity_noise = np.std(renewed.v - self.motion.v, axis=0)
        self._cache: dict[tuple[str, Location], list[_Block]] = {}

    def weak(self, signal: Array) -> Array:
        """Weak form of a signal: (T, …) → (R, …)."""
        kernel = _kernel()
        half = WINDOW // 2
        out = np.zeros((len(self.rows), *signal.shape[1:]))
        for k, weight in enumerate(kernel):
            out += weight * signal[self.rows + k - half]
        return out

    def rank(self, accepted: Sequence[tuple[Planted, Shape | None]]) -> list[Scored]:
        """Every effect at every place, best shape each, by falling gain.

        Args:
            accepted: effects found already, with the shape of their signature; they stay free.
        """
        base = _Base(self, [self._accepted(p, s) for p, s in accepted if s is not None])
        taken = {p.key for p, _ in accepted}
        scored: list[tuple[float, _Block]] = []
        for effect in effects().values():
            for at in effect.places(self.motion.scene):
                if (effect.id, at.kind, at.name) in taken:
                    continue
                options = [(base.gain(b), b) for b in self._blocks(effect, at) if b.columns.size]
                if options:
                    scored.append(max(options, key=lambda o: o[0]))
        scored.sort(key=lambda o: -o[0])
        best = [
            self._refined(base, gain, block) if gain > 0.0 and i < REFINED else _scored(base, block)
            for i, (gain, block) in enumerate(scored)
        ]
        return sorted(best, key=lambda s: -s.gain)

    def _blocks(self, effect: Effect, at: Location) -> list[_Block]:
        key = (effect.id, at)
        if key not in self._cache:
            self._cache[key] = [
                self._block(effect, at, shape) for shape in effect.shapes(self.motion, at)
            ]
        return self._cache[key]

    def _block(self, effect: Effect, at: Location, shape: Shape) -> _Block:
        return _Block(effect, at, shape, self.weak(effect.columns(self.motion, at, shape)))

    def _accepted(self, planted: Planted, shape: Shape) -> Array:
        return self._block(planted.effect, planted.at, shape).columns

    def _refined(self, base: _Base, gain: float, block: _Block) -> Scored:
        """The shape polished by Nelder-Mead, and the parameters that belong to it."""
        shape = np.array(block.shape)
        if shape.size and (shape > 0.0).all():

            def cost(log_shape: Array) -> float:
                trial = tuple(float(x) for x in np.exp(log_shape))
                return -base.gain(self._block(block.effect, block.at, trial))

            spread = np.vstack([np.log(shape), np.log(shape) + 0.25 * np.eye(shape.size)])
            found = minimize(
                cost,
                np.log(shape),
                method="Nelder-Mead",
                options={"maxfev": 18 * shape.size, "initial_simplex": spread, "fatol": 0.3},
            )
            if -found.fun > gain:
                trial = tuple(float(x) for x in np.exp(found.x))
                block = self._block(block.effect, block.at, trial)
        return _scored(base, block)


def _scored(base: _Base, block: _Block) -> Scored:
    theta = np.nan_to_num(block.effect.theta(base.coefficients(block), block.shape))
    theta = np.clip(theta, *block.effect.bounds())
    return Scored(Planted(block.effect, block.at, theta), block.shape, base.gain(block))


class _Base:
    """What adapts freely beside a hypothesis: accepted effects, and nuisances in their box."""

    def __init__(self, screen: Screen, accepted: Sequence[Array]) -> None:
        self.screen = screen
        self.keep = screen.keep
        columns = np.concatenate([*accepted, screen.nuisance], axis=2)
        bound = boxed(columns, screen)
        self.weight = self.keep / np.maximum(np.mean(screen.residual**2, axis=0), screen.floor**2)
        for _ in range(3):
            x = bounded(columns, screen.residual, self.weight, bound)
            self.left = screen.residual - columns @ x
            self.mse = self._mse(self.left)
            self.weight = self.keep / self.mse
        inside = np.abs(x) < bound - 1e-6
        inside[0] |= not inside.any()  # never nothing at all
        self.columns = columns[:, :, inside]
        flat = self.columns.reshape(self.columns.shape[0] * self.columns.shape[1], -1)
        gram = flat.T @ (self.weight.reshape(-1, 1) * flat)
        gram += 1e-9 * np.trace(gram) / max(len(gram), 1) * np.eye(len(gram))
        self.factor = cho_factor(gram)

    def _mse(self, left: Array) -> Array:
        count = np.maximum(self.keep.sum(axis=0), 1)
        return np.maximum((self.keep * left**2).sum(axis=0) / count, self.screen.floor**2)

    def coefficients(self, block: _Block) -> Array:
        """Least squares coefficients of a block, everything else free, (k,)."""
        return self._solve(block)[0]

    def _solve(self, block: _Block) -> tuple[Array, Array]:
        """(coefficients, what is left of the residual)."""
        k = block.columns.shape[2]
        flat, w = block.columns.reshape(-1, k), self.weight.reshape(-1, 1)
        base = self.columns.reshape(-1, self.columns.shape[2])
        weighted = w * flat
        cross = base.T @ weighted
        adapt = cho_solve(self.factor, cross)
        gram = flat.T @ weighted - cross.T @ adapt
        size = np.sqrt(np.maximum(np.diag(flat.T @ weighted), 1e-300))
        scaled = gram / size / size[:, None] + 1e-7 * np.eye(k)
        right = weighted.T @ self.left.reshape(-1) / size
        c = np.linalg.solve(scaled, right) / size
        left = self.left - (flat @ c - base @ (adapt @ c)).reshape(self.left.shape)
        return c, left

    def gain(self, block: _Block) -> float:
        """Log-likelihood gained by a block, less half a log of the sample count per parameter."""
        if not np.isfinite(block.columns).all() or not block.columns.any():
            return -np.inf
        c, left = self._solve(block)
        for sign, value in zip(block.effect.signed, c, strict=False):
            if sign * value < 0.0:
                return -np.inf
        # neighbouring windows overlap: only every WINDOW / STRIDE-th row is new
        count = self.keep.sum(axis=0) * STRIDE / WINDOW
        gained = 0.5 * count * np.log(self.mse / self._mse(left))
        price = 0.5 * (block.effect.n_theta) * np.log(max(count.sum(), 2.0))
        return float(gained.sum() - price)


def boxed(columns: Array, screen: Screen) -> Array:
    """Bounds of columns of which the last are the nuisances: their box, and none for the rest."""
    bound = np.full(columns.shape[2], np.inf)
    bound[columns.shape[2] - screen.nuisance.shape[2] :] = BOX
    return bound


def bounded(columns: Array, target: Array, weight: Array, bound: Array) -> Array:
    """Weighted least squares inside ±bound, by way of the Gram matrix' root.

    Args:
        columns: (R, nv, n).
        target: (R, nv).
        weight: (R, nv).
        bound: largest coefficients, (n,).
    """
    root = np.sqrt(weight).reshape(-1, 1)
    flat = columns.reshape(-1, columns.shape[2]) * root
    gram = flat.T @ flat
    scale = np.sqrt(np.diag(gram)) + 1e-300
    right = flat.T @ (target.reshape(-1) * root[:, 0]) / scale
    gram = gram / scale / scale[:, None] + 1e-10 * np.eye(len(gram))
    factor = np.linalg.cholesky(gram)
    found = lsq_linear(factor.T, np.linalg.solve(factor, right), (-bound * scale, bound * scale))
    return np.asarray(found.x / scale)


def _kernel() -> Array:
    kernel = np.cos(np.linspace(-np.pi / 2, np.pi / 2, WINDOW + 2)[1:-1]) ** 2
    return np.asarray(kernel / kernel.sum())


def _centres(motion: Motion) -> Array:
    half = WINDOW // 2 + _EDGE
    rows = [np.arange(s.rows.start + half, s.rows.stop - half, STRIDE) for s in motion.segments]
    return np.concatenate(rows)


def _fast_enough(motion: Motion, rows: Array) -> Array:
    """Rows that count for each degree of freedom, (R, nv): moving, unless that drops most."""
    keep = np.abs(motion.v[rows]) > SLOW
    keep[:, keep.mean(axis=0) < 0.5] = True
    return keep
