"""What accepted effects and the errors of any rig leave of the weak force residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from wt.diagnose.objective import Hypothesis
from wt.diagnose.screen import Screen, bounded, boxed
from wt.physics.effect import Shape
from wt.physics.motion import Motion
from wt.physics.replay import Planted

Array = np.ndarray

_EXACT = 1e-3  # relative misfit of parameters at which a shape counts as theirs


@dataclass(frozen=True, eq=False)
class Leftover:
    """The weak force residual, taken apart.

    Attributes:
        left: what nothing explains, (R, nv) [N·m].
        adapted: what the errors of any rig explain, (R, nv).
        parts: force of each effect of the hypothesis, (R, nv) each; zero where an effect has no
            signature in forces.
        keep: rows that count for each degree of freedom: moving, unless that drops most, (R, nv).
    """

    left: Array
    adapted: Array
    parts: tuple[Array, ...]
    keep: Array

    def without(self, index: int) -> Array:
        """What is left if one of the effects is taken back, (R, nv) [N·m]."""
        return np.asarray(self.left + self.parts[index])


def leftover(screen: Screen, hypothesis: Hypothesis) -> Leftover:
    """Fit the signatures of a hypothesis and the bounded nuisances to the weak residual."""
    signatures = [signature(screen.motion, p) for p in hypothesis]
    free = [screen.weak(s) for s in signatures if s is not None]
    columns = np.concatenate([*free, screen.nuisance], axis=2)
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


def signature(motion: Motion, planted: Planted) -> Array | None:
    """An effect's generalised force per coefficient, (T, nv, k), for the shape of its parameters.

    None if it has no signature in forces.
    """
    effect, at = planted.effect, planted.at
    shapes = effect.shapes(motion, at)
    if not shapes:
        return None
    columns = effect.columns(motion, at, shapes[0])
    if not shapes[0]:
        return columns
    return effect.columns(motion, at, _shape(planted, shapes, columns.shape[2]))


def _shape(planted: Planted, shapes: Sequence[Shape], k: int) -> Shape:
    """The shape whose parameters, with suitable coefficients, are those of the effect."""
    effect, theta = planted.effect, planted.theta
    scale = np.abs(theta) + effect.steps()
    best: tuple[float, Shape] = (np.inf, shapes[0])
    for shape in shapes:

        def miss(z: Array) -> Array:
            made = effect.theta(z[:k], tuple(float(s) for s in z[k:]))
            return np.nan_to_num((made - theta) / scale, nan=1e3, posinf=1e3, neginf=-1e3)

        start = np.concatenate([np.full(k, float(np.median(np.abs(theta)))), shape])
        found = least_squares(miss, start, x_scale=np.abs(start) + 1e-3, max_nfev=40)
        cost = float(np.sqrt(2.0 * found.cost))
        if cost < best[0]:
            best = (cost, tuple(float(s) for s in found.x[k:]))
        if cost < _EXACT:
            break
    return best[1]
