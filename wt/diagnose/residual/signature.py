"""The generalised force of effects with given parameters along a recorded motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from wt.physics.effect import Shape
from wt.physics.hooks import around, n_fitted
from wt.physics.motion import Motion
from wt.physics.planted import Planted

_EXACT = 1e-3  # relative misfit of parameters at which a shape counts as theirs


def elsewhere(motion: Motion, hypothesis: Sequence[Planted]) -> tuple[Planted, ...]:
    """A hypothesis as it shows in other recordings: what happens at times happens at theirs.

    Those times are read off what the other effects leave of the residual, as large as they are:
    fitted to it once more, the model's tolerances would take events for their own.
    """
    if not any(p.observed() for p in hypothesis):
        return tuple(hypothesis)
    rest = without(motion, [p for p in hypothesis if not p.observed()])
    return tuple(p.elsewhere(rest) if p.observed() else p for p in hypothesis)


def without(motion: Motion, hypothesis: Sequence[Planted]) -> Motion:
    """A motion without the force of effects, as large as they are found to be."""
    for planted in hypothesis:
        known = force(motion, planted)
        motion = motion if known is None else motion.without(known)
    return motion


def force(motion: Motion, planted: Planted) -> Float[np.ndarray, "sample dof"] | None:
    """An effect's generalised force [N·m]; None if it has no signature in forces."""
    shaped = _shaped(motion, planted)
    if shaped is None:
        return None
    columns, shape = shaped
    effect, own = planted.effect, around(planted.effect, planted.theta)
    if own is not None:  # elsewhere its columns are no more than slopes
        columns, shape = effect.columns(motion, planted.at, own), own
    scale = np.abs(planted.theta) + effect.steps()

    def miss(coefficients: Float[np.ndarray, " coefficient"]) -> Float[np.ndarray, " parameter"]:
        off = (effect.theta(coefficients, shape) - planted.theta) / scale
        return np.nan_to_num(off, nan=1e3, posinf=1e3, neginf=-1e3)

    return np.asarray(columns @ least_squares(miss, np.ones(columns.shape[2])).x)


def unsaid(motion: Motion, law: Planted, named: Sequence[Planted], dof: int) -> float:
    """Share of a law's squared force at a degree of freedom that no multiple of named effects is.

    Args:
        motion: along which they act.
        law: a force of any kind.
        named: effects whose sizes are free.
        dof: where they are compared.

    Returns:
        0 for a law that they say themselves, 1 for one that has nothing of them.
    """
    of_law = force(motion, law)
    signatures = [s[:, dof] for s in (signature(motion, p) for p in named) if s is not None]
    if of_law is None or not signatures:
        return 1.0
    target, design = of_law[:, dof], np.concatenate(signatures, axis=1)
    size = np.linalg.norm(design, axis=0) + 1e-12
    x, *_ = np.linalg.lstsq(design / size, target, rcond=1e-8)
    left = target - (design / size) @ x
    return float(left @ left / (target @ target + 1e-24))


def reduced(motion: Motion, hypothesis: Sequence[Planted]) -> Motion:
    """A motion without what some effects, fitted by least squares, explain of its residual."""
    signatures = [s for s in (signature(motion, p) for p in hypothesis) if s is not None]
    if not signatures:
        return motion
    scale = np.std(motion.residual, axis=0) + 1e-12
    columns = np.concatenate(signatures, axis=2)
    design = (columns / scale[:, None]).reshape(motion.residual.size, -1)
    size = np.linalg.norm(design, axis=0) + 1e-12
    x, *_ = np.linalg.lstsq(design / size, (motion.residual / scale).reshape(-1), rcond=1e-8)
    return motion.without(columns @ (x / size))


def signature(
    motion: Motion, planted: Planted
) -> Float[np.ndarray, "sample dof coefficient"] | None:
    """An effect's generalised force per coefficient, for the shape of its parameters.

    None if it has no signature in forces.
    """
    shaped = _shaped(motion, planted)
    return None if shaped is None else shaped[0]


def _shaped(
    motion: Motion, planted: Planted
) -> tuple[Float[np.ndarray, "sample dof coefficient"], Shape] | None:
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

        def completed(z: Float[np.ndarray, " unknown"], shape: Shape = shape) -> Shape:
            return (*(float(s) for s in z[free:]), *shape[fitted:])

        def miss(
            z: Float[np.ndarray, " unknown"],
            completed: Callable[[Float[np.ndarray, " unknown"]], Shape] = completed,
        ) -> Float[np.ndarray, " parameter"]:
            made = effect.theta(np.concatenate([z[:free], ones]), completed(z))
            return np.nan_to_num((made - theta) / scale, nan=1e3, posinf=1e3, neginf=-1e3)

        start = np.concatenate([np.full(free, float(np.median(np.abs(theta)))), shape[:fitted]])
        fit = least_squares(miss, start, x_scale=np.abs(start) + 1e-3, max_nfev=40)
        cost = float(np.sqrt(2.0 * fit.cost))
        if cost < best[0]:
            best = (cost, completed(fit.x))
        if cost < _EXACT:
            break
    return best[1]
