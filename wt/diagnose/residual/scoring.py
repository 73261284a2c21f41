"""Log-likelihood that hypotheses gain on the force residual, everything else free to adapt.

Linear least squares throughout: accepted effects are free, the model's tolerances adapt inside
their box, and a hypothesis' coefficients are solved for together with both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from wt.diagnose.likelihood.bounded import NormalEquations
from wt.diagnose.likelihood.tolerances import ModelTolerance, boxes
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Effect, Shape
from wt.physics.hooks import shaped
from wt.physics.planted import Planted
from wt.types import Location

WINDOW, STRIDE = 13, 5
"""Length and spacing of the weak form's cos² windows, in samples."""
_IDLE = 1e-16  # of the largest square of a signature's columns
_RIDGE, _FREE_RIDGE = 1e-7, 1e-10  # of the squares, with a hypothesis and without


@runtime_checkable
class WeakResidual(Protocol):
    """The weak force residual, and the weak forces of tolerances; see ``screen.Screen``.

    Attributes:
        residual: [N·m].
        floor: standard deviation that measurement noise gives it [N·m].
        keep: rows that count for each degree of freedom.
        tolerances: of the model.
        tolerance_forces: weak force of one deviation of each [N·m].
    """

    residual: Float[np.ndarray, "row dof"]
    floor: Float[np.ndarray, " dof"]
    keep: Bool[np.ndarray, "row dof"]
    tolerances: tuple[ModelTolerance, ...]
    tolerance_forces: Float[np.ndarray, "row dof tolerance"]


@dataclass(frozen=True, eq=False)
class Signature:
    """Weak force of a hypothesis with its shape given.

    Attributes:
        effect: what.
        at: where.
        shape: its nonlinear parameters.
        dofs: degrees of freedom that it acts on.
        columns: weak force on these per unit of each coefficient.
    """

    effect: Effect
    at: Location
    shape: Shape
    dofs: Int[np.ndarray, " acted"]
    columns: Float[np.ndarray, "row acted coefficient"]

    @property
    def usable(self) -> bool:
        """Tell whether there is anything to score."""
        return bool(self.columns.size and np.isfinite(self.columns).all() and self.columns.any())

    @cached_property
    def bound(self) -> Effect:
        """The effect bound to the shape."""
        return shaped(self.effect, self.shape)

    @property
    def alone(self) -> Signature:
        """Only its first column: what has no size stays nothing."""
        first = np.arange(self.columns.shape[2]) == 0
        return replace(self, columns=self.columns * first)

    @property
    def signs(self) -> Float[np.ndarray, " coefficient"]:
        """Sign that each coefficient must have, 0 for any."""
        signs = np.zeros(self.columns.shape[2])
        given = self.bound.signed[: len(signs)]
        signs[: len(given)] = given
        return signs

    def on(self, dofs: Sequence[int]) -> Float[np.ndarray, "row asked coefficient"]:
        """Weak force on some degrees of freedom, in their order."""
        columns = np.zeros((len(self.columns), len(dofs), self.columns.shape[2]))
        both = [(dofs.index(d), m) for m, d in enumerate(self.dofs) if d in dofs]
        for here, there in both:
            columns[:, here] = self.columns[:, there]
        return columns

    def planted(self, coefficients: Float[np.ndarray, " coefficient"]) -> Planted:
        """The effect with the parameters that belong to coefficients."""
        theta = np.nan_to_num(self.bound.theta(coefficients, self.shape))
        return Planted(self.bound, self.at, np.clip(theta, *self.bound.bounds()))


class FreeFit:
    """Fit of all that adapts beside a hypothesis: accepted effects, and tolerances in their box."""

    def __init__(
        self, screen: WeakResidual, accepted: Sequence[Float[np.ndarray, "row dof _"]]
    ) -> None:
        """Fit what adapts, given the signatures of the accepted effects."""
        self.screen = screen
        self.keep = screen.keep
        columns = np.concatenate([*accepted, screen.tolerance_forces], axis=2)
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

    def _room(self, hypothesis: Sequence[Planted]) -> Float[np.ndarray, "2 adapting"]:
        """Room for what adapts to move either way: to nothing, where the hypothesis settles it."""
        size, room = boxes(self.screen.tolerances, hypothesis), self.room.copy()
        settled = np.flatnonzero(size == 0.0) + room.shape[1] - len(size)
        room[:, settled] = self.room[:, settled].mean(axis=0)
        return room

    def _mse(self, squares: Float[np.ndarray, " dof"]) -> Float[np.ndarray, " dof"]:
        count = np.maximum(self.keep.sum(axis=0), 1)
        return np.maximum(squares / count, self.screen.floor**2)

    def _nats(self, squares: Float[np.ndarray, " dof"]) -> Float[np.ndarray, " dof"]:
        """Nats that a row of each joint costs; errors within the noise count too."""
        mse, mean = self._mse(squares), squares / np.maximum(self.keep.sum(axis=0), 1)
        return np.asarray(0.5 * (np.log(mse) + mean / mse))

    def fit(self, *signatures: Signature) -> tuple[float, tuple[Planted, ...]]:
        """Fit hypotheses together, everything else free to adapt.

        Returns:
            (log-likelihood gained, less half a log of the sample count per parameter; the effects
            with the parameters found).
        """
        if not all(s.usable for s in signatures):
            return -np.inf, tuple(s.planted(np.zeros(s.columns.shape[2])) for s in signatures)
        coefficients, squares = self._solve(signatures)
        planted, price, start = [], 0, 0
        for signature in signatures:
            end = start + signature.columns.shape[2]
            planted.append(signature.planted(coefficients[start:end]))
            price += planted[-1].effect.n_free
            start = end
        # neighbouring windows overlap: only every WINDOW / STRIDE-th row is new
        count = self.keep.sum(axis=0) * STRIDE / WINDOW
        gained = float(count @ (self._nats(self.squares) - self._nats(squares)))
        gained -= 0.5 * price * float(np.log(max(count.sum(), 2.0)))
        return gained, tuple(planted)

    def _solve(
        self, signatures: Sequence[Signature]
    ) -> tuple[Float[np.ndarray, " coefficient"], Float[np.ndarray, " dof"]]:
        """Coefficients of all signatures, with the signs they must have; squares left per joint."""
        dofs = sorted({int(d) for s in signatures for d in s.dofs})
        columns = np.concatenate([s.on(dofs) for s in signatures], axis=2)
        signs = np.concatenate([s.signs for s in signatures])
        k = columns.shape[2]
        kept = columns * self.keep[:, dofs, None]
        own = [kept[:, m].T @ columns[:, m] for m in range(len(dofs))]
        cross = [self.columns[:, d].T @ kept[:, m] for m, d in enumerate(dofs)]
        right = [kept[:, m].T @ self.left[:, d] for m, d in enumerate(dofs)]
        weight = 1.0 / self.mse[dofs]
        mixed = np.tensordot(weight, cross, 1)
        gram = np.empty((k + len(mixed), k + len(mixed)))
        gram[:k, :k], gram[:k, k:] = np.tensordot(weight, own, 1), mixed.T
        gram[k:, :k], gram[k:, k:] = mixed, self.gram
        room = self._room([Planted(s.bound, s.at, np.zeros(0)) for s in signatures])
        low = np.concatenate([np.where(signs > 0, 0.0, -np.inf), room[0]])
        high = np.concatenate([np.where(signs < 0, 0.0, np.inf), room[1]])
        # a push along an axis, say, that moves no joint: its size is anybody's guess
        size = np.diag(gram)[:k]
        idle = np.flatnonzero(size < _IDLE * size.max())
        low[idle], high[idle] = 0.0, 0.0
        both = np.concatenate([weight @ right, self.right])
        # nothing, and what adapts as it does without: the answer is close to that
        step = NormalEquations(gram, both, _RIDGE).pivoted(low, high, np.zeros(len(both)))
        x, rest = step[:k], step[k:]
        squares = self.squares - 2.0 * self.cross @ rest + self.grams @ rest @ rest
        for m, d in enumerate(dofs):
            squares[d] += x @ own[m] @ x - 2.0 * right[m] @ x + 2.0 * rest @ cross[m] @ x
        return x, np.maximum(squares, 0.0)


def boxed(
    columns: Float[np.ndarray, "row dof adapting"], screen: WeakResidual
) -> Float[np.ndarray, " adapting"]:
    """Bounds of columns of which the last are the tolerances: their box, and none for the rest."""
    bound = np.full(columns.shape[2], np.inf)
    bound[columns.shape[2] - screen.tolerance_forces.shape[2] :] = THRESHOLDS.tolerance_box
    return bound


def bounded(
    columns: Float[np.ndarray, "row dof adapting"],
    target: Float[np.ndarray, "row dof"],
    weight: Float[np.ndarray, "row dof"],
    bound: Float[np.ndarray, " adapting"],
) -> Float[np.ndarray, " adapting"]:
    """Weighted least squares inside ±bound.

    Args:
        columns: change of the target per unit of each coefficient.
        target: to be met.
        weight: of each square.
        bound: largest coefficients.
    """
    root = np.sqrt(weight).reshape(-1, 1)
    flat = columns.reshape(-1, columns.shape[2]) * root
    right = flat.T @ (target.reshape(-1) * root[:, 0])
    return NormalEquations(flat.T @ flat, right, _FREE_RIDGE).reflected(-bound, bound)
