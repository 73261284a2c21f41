"""An elastic element that yields: presliding friction, harness and seal drag.

How far it is bent when a replay begins comes of all the way that the joint went before: in the
middle of a recording it is as good as never unbent.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import LEAST, Parameter, Shape, register
from wt.physics.hooks import Intervals, Nested, Remembering
from wt.physics.motion import Motion
from wt.physics.parts import add_tendon
from wt.physics.replay import Stretch
from wt.physics.units import HINGE, Units
from wt.types import Location

_PRESLIDING = 0.1
"""Share of a joint's travel within which bristles of dry friction bend."""


def _followed(q: np.ndarray, most: float) -> np.ndarray:
    bend, bends = 0.0, np.empty(len(q))
    for k in range(len(q)):
        if k:
            bend = min(max(bend + q[k] - q[k - 1], -most), most)
        bends[k] = bend
    return bends


@functools.cache
def _compiled() -> Callable[[np.ndarray, float], np.ndarray]:
    from wt.physics.compiled import fast  # takes a second to import

    made: Callable[[np.ndarray, float], np.ndarray] = fast(_followed)
    return made


def bent(q: Float[np.ndarray, " sample"], most: float) -> Float[np.ndarray, " sample"]:
    """How far an element is bent along a joint's way, unbent to begin with [rad].

    Args:
        q: positions of the joint [rad].
        most: bend at which the element yields [rad].
    """
    return _compiled()(np.ascontiguousarray(q, dtype=float), float(most))


@register
class Hysteresis(Nested, Remembering):
    """τ = −z with ż = stiffness · v while |z| < yield (Prandtl's elasto-plastic element)."""

    id = "joint.hysteresis"
    kind = "joint"
    parameters = (
        Parameter("stiffness", "N·m/rad", LEAST, 1e8, 1e-2, inexact=0.03),
        Parameter("yield", "N·m", 0.0, 1e8, 1e-3, neutral=0.0, inexact=0.03),
    )
    reference = "L. Prandtl, Ein Gedankenmodell zur kinetischen Theorie der festen Körper, 1928"
    signed = (1,)
    looks_like = ("spring",)
    each_way = True

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Deflections at which it yields, from a fraction of the range down."""
        reach = _reach(motion, at)
        return [(f * reach,) for f in (0.02, 0.06, 0.15, 0.3) if reach > 0.0]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Deflection of the element, with sign."""
        dof = motion.scene.dof(at.name)
        z = np.empty(len(motion))
        for s in motion.segments:
            z[s.rows] = bent(motion.q[s.rows, dof], shape[0])
        return motion.on(dof, -z)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """(stiffness, yield)."""
        return np.array([coefficients[0], coefficients[0] * shape[0]])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """A fixed tendon over the joint with an elasto-plastic spring."""
        if theta[1] > 0.0:
            name = f"{at.name}_hysteresis"
            stiffness, bend = [theta[0], 0.0, 0.0], float(theta[1] / theta[0])
            tendon = add_tendon(spec, name, stiffness=stiffness, springyield=bend)
            tendon.wrap_joint(at.name, 1.0)

    def remembered(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, float]:
        """How far the tendon is bent by the way that the joint went in the recording before."""
        motion, segment, bend = stretch.motion, stretch.segment, 0.0
        if theta[1] <= 0.0:
            return {}
        if motion is not None and segment is not None:
            dof = motion.scene.dof(at.name)
            before = motion.t[segment.rows] < stretch.t[0] - 1e-9
            way = motion.q[segment.rows, dof][before]
            bend = float(bent(np.append(way, stretch.q0[dof]), theta[1] / theta[0])[-1])
        return {f"{at.name}_hysteresis bend": bend}

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse what yields within a quarter of a degree: dry friction before it slides."""
        return bool(theta[1] > 0.004 * theta[0])

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Coulomb's, which is no elastic before it slides, where it slides nearly all the way."""
        if theta[1] > _PRESLIDING * theta[0] * _reach(motion, at):
            return None
        return "joint.friction_coulomb", theta[1:]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} has hysteresis: an elastic {theta[0]:.3g} {units.stiffness} that "
            f"yields at {theta[1]:.3g} {units.force}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"nested reversals of {at.name}, each smaller than the one before"


def _reach(motion: Motion, at: Location) -> float:
    """Travel of a joint, but for its ends [rad]."""
    q = motion.q[:, motion.scene.dof(at.name)]
    return float(np.quantile(q, 0.99) - np.quantile(q, 0.01))
