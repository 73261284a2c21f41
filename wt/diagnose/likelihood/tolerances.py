"""Model tolerances: small errors of masses, damping, gains and timing that are no finding.

A model made of a data sheet is never exact. Each of these errors is known in size, not in value;
hypotheses are compared with all of them free inside their box, so that what a few per cent of
mass explains is never blamed on missing physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.hooks import Tolerance, Tolerated
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis, Key, Planted
from wt.physics.scene import Scene
from wt.types import Location

_DIGITS = 5  # of deviations


@dataclass(frozen=True, eq=False)
class ModelTolerance:
    """One small error of unknown sign, at its place.

    Attributes:
        effect: expresses it.
        at: its place.
        tolerance: its size.
    """

    effect: Tolerated
    at: Location
    tolerance: Tolerance

    @cached_property
    def planted(self) -> Planted:
        """The effect of an error of one standard deviation."""
        return Planted(self.effect, self.at, np.array([self.neutral + self.tolerance.size]))

    @property
    def neutral(self) -> float:
        """Its parameter when there is no error."""
        (parameter,) = self.effect.parameters
        assert parameter.neutral is not None
        return parameter.neutral

    def scaled(self, size: float) -> Planted:
        """The effect of an error of ``size`` standard deviations, or of the most there can be."""
        theta = self.neutral + size * (self.planted.theta - self.neutral)
        return Planted(self.effect, self.at, np.maximum(theta, self.tolerance.lowest))


def tolerances(scene: Scene) -> tuple[ModelTolerance, ...]:
    """The errors that any model of this machine may have: of its bodies, its joints, its drives."""
    bodies = [Location("body", name) for name in scene.moving]
    joints = [Location("joint", name) for name in scene.own_joints]
    drives = [Location("actuator", drive.name) for drive in scene.drives]
    order = {at: i for i, at in enumerate([*bodies, *joints, Location("sensor", "all"), *drives])}
    unsorted = [
        ModelTolerance(effect, at, tolerance)
        for effect in effects().values()
        if isinstance(effect, Tolerated)
        for at, tolerance in effect.tolerances(scene).items()
    ]
    # sums are rounded in the order of their terms: for the same answer to the last digit, it stays
    return tuple(sorted(reversed(unsorted), key=lambda t: order[t.at]))


def boxes(
    tolerances: Sequence[ModelTolerance], hypothesis: Sequence[Planted]
) -> Float[np.ndarray, " tolerance"]:
    """Largest size of each beside a hypothesis [deviations]: 0 where that settles it."""
    box, known = np.full(len(tolerances), THRESHOLDS.tolerance_box), _indices(tuple(tolerances))
    for p in hypothesis:
        for name in p.effect.settles:
            box[known.get((name, p.at.kind, p.at.name), [])] = 0.0
    return box


@lru_cache(maxsize=64)
def _indices(tolerances: tuple[ModelTolerance, ...]) -> dict[Key, list[int]]:
    """Where errors of a kind at a place are among all."""
    known: dict[Key, list[int]] = {}
    for i, tolerance in enumerate(tolerances):
        known.setdefault(tolerance.planted.key, []).append(i)
    return known


def rounded(
    sizes: Float[np.ndarray, " tolerance"], box: Float[np.ndarray, " tolerance"]
) -> Float[np.ndarray, " tolerance"]:
    """Sizes inside their boxes, as finely as any replay tells them [deviations].

    Those of a limb that a step leaves alone are then the same, to the bit, as after other steps,
    and it is replayed once for all of them.
    """
    return np.clip(np.round(sizes, _DIGITS), -box, box)


def alike(
    tolerances: Sequence[ModelTolerance], hypothesis: Sequence[Planted]
) -> Bool[np.ndarray, " tolerance"]:
    """Which are the small error of something that a hypothesis has: only the sum of both shows."""
    keys = {p.key for p in hypothesis}
    return np.array([t.planted.key in keys for t in tolerances], dtype=bool)


def taken_over(
    tolerances: Sequence[ModelTolerance],
    sizes: Float[np.ndarray, " tolerance"],
    planted: Planted,
) -> Float[np.ndarray, " tolerance"]:
    """Small errors as they are once an effect is one of them, as far as that fits [deviations].

    Unchanged where the effect is no small error of any model.
    """
    taken, box = sizes.copy(), THRESHOLDS.tolerance_box
    for i in np.flatnonzero(alike(tolerances, [planted])).tolist():
        neutral, (one,) = tolerances[i].neutral, tolerances[i].planted.theta
        off = (planted.theta[0] - neutral) / (one - neutral)
        taken[i] = np.clip(taken[i] + off, -box, box)
    return taken


def absorbed(
    tolerances: Sequence[ModelTolerance],
    sizes: Float[np.ndarray, " tolerance"],
    hypothesis: Hypothesis,
) -> Hypothesis:
    """The hypothesis with the small errors of its own kinds in its parameters [deviations]."""
    errors = {t.planted.key: t.scaled(float(x)) for t, x in zip(tolerances, sizes, strict=True)}
    parts = []
    for p in hypothesis:
        error = errors.get(p.key)
        if error is not None:
            (parameter,) = p.effect.parameters
            factor = parameter.neutral == 1.0
            theta = p.theta * error.theta if factor else p.theta + error.theta
            p = Planted(p.effect, p.at, np.clip(theta, *p.effect.bounds()))
        parts.append(p)
    return tuple(parts)


def forces(
    motion: Motion, tolerances: Sequence[ModelTolerance]
) -> list[Float[np.ndarray, "sample dof"]]:
    """Generalised force of each error, one standard deviation large [N·m]."""
    sizes = [float(t.planted.theta[0] - t.neutral) for t in tolerances]
    pairs = zip(tolerances, sizes, strict=True)
    return [t.effect.small(motion, t.at, size) for t, size in pairs]
