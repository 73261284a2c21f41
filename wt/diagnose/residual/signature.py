"""The generalised force of effects with given parameters along a recorded motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from wt.physics.effect import Shape
from wt.physics.hooks import n_fitted
from wt.physics.motion import Motion
from wt.physics.planted import Planted

Array = np.ndarray

_EXACT = 1e-3  # relative misfit of parameters at which a shape counts as theirs


def elsewhere(motion: Motion, hypothesis: Sequence[Planted]) -> tuple[Planted, ...]:
    """A hypothesis as it shows in other recordings: what happens at times happens at theirs.

    Those times are read off what the other effects leave of the residual, as large as they are:
    fitted to it once more, what any rig is off by would take events for its own.
    """
    if not any(p.observed() for p in hypothesis):
        return tuple(hypothesis)
    rest = motion
    for planted in hypothesis:
        known = None if planted.observed() else force(motion, planted)
        rest = rest if known is None else rest.without(known)
    return tuple(p.elsewhere(rest) if p.observed() else p for p in hypothesis)


def force(motion: Motion, planted: Planted) -> Array | None:
    """An effect's generalised force, (T, nv) [N·m]; None if it has no signature in forces."""
    found = _shaped(motion, planted)
    if found is None:
        return None
    columns, shape = found
    effect = planted.effect
    scale = np.abs(planted.theta) + effect.steps()

    def miss(coefficients: Array) -> Array:
        off = (effect.theta(coefficients, shape) - planted.theta) / scale
        return np.nan_to_num(off, nan=1e3, posinf=1e3, neginf=-1e3)

    return np.asarray(columns @ least_squares(miss, np.ones(columns.shape[2])).x)


def reduced(motion: Motion, some: Sequence[Planted]) -> Motion:
    """A motion without what some effects, fitted by least squares, explain of its residual."""
    found = [s for s in (signature(motion, p) for p in some) if s is not None]
    if not found:
        return motion
    scale = np.std(motion.residual, axis=0) + 1e-12
    columns = np.concatenate(found, axis=2)
    design = (columns / scale[:, None]).reshape(motion.residual.size, -1)
    size = np.linalg.norm(design, axis=0) + 1e-12
    x, *_ = np.linalg.lstsq(design / size, (motion.residual / scale).reshape(-1), rcond=1e-8)
    return motion.without(columns @ (x / size))


def signature(motion: Motion, planted: Planted) -> Array | None:
    """An effect's generalised force per coefficient, (T, nv, k), for the shape of its parameters.

    None if it has no signature in forces.
    """
    found = _shaped(motion, planted)
    return None if found is None else found[0]


def _shaped(motion: Motion, planted: Planted) -> tuple[Array, Shape] | None:
    """The columns of :func:`signature`, and the shape they are of."""
    effect, at = planted.effect, planted.at
    shapes = effect.shapes(motion, at)
    if not shapes:
        return None
    columns, shape = effect.columns(motion, at, shapes[0]), shapes[0]
    if shape:
        shape = _shape(planted, shapes, columns.shape[2])
        columns = effect.columns(motion, at, shape)
    return columns, shape


def _shape(planted: Planted, shapes: Sequence[Shape], k: int) -> Shape:
    """The shape whose parameters, with suitable coefficients, are those of the effect."""
    effect, theta = planted.effect, planted.theta
    scale = np.abs(theta) + effect.steps()
    fitted = n_fitted(effect, shapes[0])
    # where coefficients and shape say the same, as of a delay, the shape says all of it
    free = k if k + fitted <= len(theta) else 0
    ones = np.ones(k - free)
    best: tuple[float, Shape] = (np.inf, shapes[0])
    for shape in shapes:

        def whole(z: Array, shape: Shape = shape) -> Shape:
            return (*(float(s) for s in z[free:]), *shape[fitted:])

        def miss(z: Array, whole: Callable[[Array], Shape] = whole) -> Array:
            made = effect.theta(np.concatenate([z[:free], ones]), whole(z))
            return np.nan_to_num((made - theta) / scale, nan=1e3, posinf=1e3, neginf=-1e3)

        start = np.concatenate([np.full(free, float(np.median(np.abs(theta)))), shape[:fitted]])
        found = least_squares(miss, start, x_scale=np.abs(start) + 1e-3, max_nfev=40)
        cost = float(np.sqrt(2.0 * found.cost))
        if cost < best[0]:
            best = (cost, whole(found.x))
        if cost < _EXACT:
            break
    return best[1]
