"""How much log-likelihood hypotheses gain on the force residual, everything else free to adapt.

Linear least squares throughout: accepted effects are free, what any rig is off by adapts inside
its box, and a hypothesis' coefficients are solved for together with both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.optimize import lsq_linear

from wt.diagnose.likelihood.tolerances import Nuisance, boxes
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Effect, Shape
from wt.physics.hooks import shaped
from wt.physics.planted import Planted
from wt.types import Location

Array = np.ndarray

WINDOW, STRIDE = 13, 5
"""Length and spacing of the weak form's cos² windows, in samples."""
_ATTEMPTS, _PATIENCE = 200, 3  # at finding which nuisances stand at their bounds
_SLACK = 1e-9
_IDLE = 1e-16  # of the largest square of a block's columns


@runtime_checkable
class WeakResidual(Protocol):
    """The weak force residual, and the weak forces of tolerances; see ``screen.Screen``.

    Attributes:
        residual: (R, nv) [N·m].
        floor: standard deviation that measurement noise gives it, (nv,) [N·m].
        keep: rows that count for each degree of freedom, (R, nv).
        nuisances: the model's tolerances.
        nuisance: weak force of one deviation of each, (R, nv, n) [N·m].
    """

    residual: Array
    floor: Array
    keep: Array
    nuisances: tuple[Nuisance, ...]
    nuisance: Array


@dataclass(frozen=True, eq=False)
class Block:
    """The signature of a hypothesis with its shape given.

    Attributes:
        effect: what.
        at: where.
        shape: its nonlinear parameters.
        dofs: degrees of freedom that it acts on, (m,).
        columns: weak force on these per unit of each coefficient, (R, m, k).
    """

    effect: Effect
    at: Location
    shape: Shape
    dofs: Array
    columns: Array

    @property
    def usable(self) -> bool:
        """Whether there is anything to score."""
        return bool(self.columns.size and np.isfinite(self.columns).all() and self.columns.any())

    @property
    def alone(self) -> Block:
        """Only its first column: what has no size stays nothing."""
        first = np.arange(self.columns.shape[2]) == 0
        return replace(self, columns=self.columns * first)

    @property
    def signs(self) -> Array:
        """Sign that each coefficient must have, 0 for any, (k,)."""
        found = np.zeros(self.columns.shape[2])
        given = self.effect.signed[: len(found)]
        found[: len(given)] = given
        return found

    def on(self, dofs: Sequence[int]) -> Array:
        """Weak force on some degrees of freedom, (R, len(dofs), k)."""
        found = np.zeros((len(self.columns), len(dofs), self.columns.shape[2]))
        both = [(dofs.index(d), m) for m, d in enumerate(self.dofs) if d in dofs]
        for here, there in both:
            found[:, here] = self.columns[:, there]
        return found

    def planted(self, coefficients: Array) -> Planted:
        """The effect with the parameters that belong to coefficients."""
        effect = shaped(self.effect, self.shape)
        theta = np.nan_to_num(effect.theta(coefficients, self.shape))
        return Planted(effect, self.at, np.clip(theta, *effect.bounds()))


class Base:
    """What adapts freely beside a hypothesis: accepted effects, and nuisances in their box."""

    def __init__(self, screen: WeakResidual, accepted: Sequence[Array]) -> None:
        """Fit what adapts, given the signatures of the accepted effects, (R, nv, k) each."""
        self.screen = screen
        self.keep = screen.keep
        columns = np.concatenate([*accepted, screen.nuisance], axis=2)
        bound = boxed(columns, screen)
        self.mse = np.maximum(np.mean(screen.residual**2, axis=0), screen.floor**2)
        for _ in range(3):
            x = bounded(columns, screen.residual, self.keep / self.mse, bound)
            self.left = screen.residual - columns @ x
            self.squares = (self.keep * self.left**2).sum(axis=0)
            self.mse = self._mse(self.squares)
        self.columns = columns
        self.room = np.stack([-bound - x, bound - x])
        # per joint: what a step costs in squares is known without looking at the rows again
        kept = columns * self.keep[:, :, None]
        self.cross = np.einsum("rji,rj->ji", kept, self.left)
        self.grams = np.stack([kept[:, j].T @ columns[:, j] for j in range(len(self.mse))])
        self.gram = np.tensordot(1.0 / self.mse, self.grams, 1)
        self.right = self.cross.T @ (1.0 / self.mse)

    def _room(self, blocks: Sequence[Planted]) -> Array:
        """How far what adapts may move either way, (2, n): to nothing, where a block settles it."""
        size, room = boxes(self.screen.nuisances, blocks), self.room.copy()
        settled = np.flatnonzero(size == 0.0) + room.shape[1] - len(size)
        room[:, settled] = self.room[:, settled].mean(axis=0)
        return room

    def _mse(self, squares: Array) -> Array:
        count = np.maximum(self.keep.sum(axis=0), 1)
        return np.maximum(squares / count, self.screen.floor**2)

    def _nats(self, squares: Array) -> Array:
        """Nats that a row of each joint costs, (nv,); errors within the noise count too."""
        mse, mean = self._mse(squares), squares / np.maximum(self.keep.sum(axis=0), 1)
        return np.asarray(0.5 * (np.log(mse) + mean / mse))

    def fit(self, *blocks: Block) -> tuple[float, tuple[Planted, ...]]:
        """Blocks together, everything else free to adapt.

        Returns:
            (log-likelihood gained, less half a log of the sample count per parameter; the effects
            with the parameters found).
        """
        if not all(b.usable for b in blocks):
            return -np.inf, tuple(b.planted(np.zeros(b.columns.shape[2])) for b in blocks)
        coefficients, squares = self._solve(blocks)
        planted, price, start = [], 0, 0
        for block in blocks:
            end = start + block.columns.shape[2]
            planted.append(block.planted(coefficients[start:end]))
            price += planted[-1].effect.n_free
            start = end
        # neighbouring windows overlap: only every WINDOW / STRIDE-th row is new
        count = self.keep.sum(axis=0) * STRIDE / WINDOW
        gained = float(count @ (self._nats(self.squares) - self._nats(squares)))
        gained -= 0.5 * price * float(np.log(max(count.sum(), 2.0)))
        return gained, tuple(planted)

    def _solve(self, blocks: Sequence[Block]) -> tuple[Array, Array]:
        """(coefficients of the blocks, with the signs they must have; squares left per joint)."""
        dofs = sorted({int(d) for b in blocks for d in b.dofs})
        columns = np.concatenate([b.on(dofs) for b in blocks], axis=2)
        signs = np.concatenate([b.signs for b in blocks])
        k = columns.shape[2]
        kept = columns * self.keep[:, dofs, None]
        own = [kept[:, m].T @ columns[:, m] for m in range(len(dofs))]
        cross = [self.columns[:, d].T @ kept[:, m] for m, d in enumerate(dofs)]
        right = [kept[:, m].T @ self.left[:, d] for m, d in enumerate(dofs)]
        weight = 1.0 / self.mse[dofs]
        mixed = np.tensordot(weight, cross, 1)
        gram = np.block([[np.tensordot(weight, own, 1), mixed.T], [mixed, self.gram]])
        room = self._room([Planted(b.effect, b.at, np.zeros(0)) for b in blocks])
        low = np.concatenate([np.where(signs > 0, 0.0, -np.inf), room[0]])
        high = np.concatenate([np.where(signs < 0, 0.0, np.inf), room[1]])
        # a push along an axis, say, that moves no joint: its size is anybody's guess
        size = np.diag(gram)[:k]
        idle = np.flatnonzero(size < _IDLE * size.max())
        low[idle], high[idle] = 0.0, 0.0
        step = _clamped(gram, np.concatenate([weight @ right, self.right]), low, high)
        x, rest = step[:k], step[k:]
        squares = self.squares - 2.0 * self.cross @ rest + self.grams @ rest @ rest
        for m, d in enumerate(dofs):
            squares[d] += x @ own[m] @ x - 2.0 * right[m] @ x + 2.0 * rest @ cross[m] @ x
        return x, np.maximum(squares, 0.0)


def _clamped(gram: Array, right: Array, low: Array, high: Array) -> Array:
    """Least squares inside a box, by block principal pivoting (Portugal, Júdice, Vicente, 1994).

    What would leave the box is held at its bound, what pulls inwards is let go again: all at a
    time while that makes fewer of them, else one at a time; scipy's way if that goes in circles.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    gram = gram / scale / scale[:, None] + 1e-7 * np.eye(len(gram))
    right, low, high = right / scale, low * scale, high * scale
    x, free = np.zeros(len(gram)), np.ones(len(gram), bool)
    fewest, patience = len(gram) + 1, _PATIENCE
    for _ in range(_ATTEMPTS):
        held = gram[np.ix_(free, ~free)] @ x[~free]
        x[free] = np.linalg.solve(gram[np.ix_(free, free)], right[free] - held)
        pull = right - gram @ x
        outside = free & ((x < low) | (x > high))
        inwards = ~free & np.where(x <= low, pull > _SLACK, pull < -_SLACK)
        wrong = np.flatnonzero(outside | inwards)
        if not len(wrong):
            return np.asarray(x / scale)
        if len(wrong) < fewest:
            fewest, patience = len(wrong), _PATIENCE
        elif patience:
            patience -= 1
        else:
            wrong = wrong[-1:]
        free[wrong] = ~free[wrong]
        x[~free] = np.clip(x[~free], low[~free], high[~free])
    factor = np.linalg.cholesky(gram)
    target, ends = np.linalg.solve(factor, right), (low - 1e-12, high + 1e-12)
    return np.asarray(lsq_linear(factor.T, target, ends, method="bvls").x / scale)


def boxed(columns: Array, screen: WeakResidual) -> Array:
    """Bounds of columns of which the last are the nuisances: their box, and none for the rest."""
    bound = np.full(columns.shape[2], np.inf)
    bound[columns.shape[2] - screen.nuisance.shape[2] :] = THRESHOLDS.tolerance_box
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
