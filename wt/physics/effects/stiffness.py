"""A spring at a joint that the model lacks."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import no_spring, per_radian
from wt.physics.hooks import Linearised
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class Stiffness(Linearised):
    """τ = −stiffness · (q − reference)."""

    id = "joint.stiffness"
    kind = "joint"
    parameters = (
        Parameter("stiffness", "N·m/rad", 0.0, 1e8, 1e-2, neutral=0.0),
        Parameter("reference", "rad", -6.5, 6.5, 1e-3),
    )
    reference = "R. Hooke, De potentia restitutiva, 1678"
    signed = (1, 0)
    looks_like = ("spring",)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−q and 1 on the joint's row."""
        dof = motion.scene.dof(at.name)
        return motion.on(dof, -motion.q[:, dof], np.ones(len(motion)))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """See :meth:`Effect.theta`."""
        return np.array([coefficients[0], coefficients[1] / max(float(coefficients[0]), 1e-9)])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the joint's ``stiffness``, moving its reference as two springs would."""
        joint = spec.joint(at.name)
        old = np.array(joint.stiffness)
        total = old[0] + theta[0]
        if total > 0.0:
            # the compiler reads springref in the model's angle unit
            unit = per_radian(joint)
            middle = (old[0] * joint.springref / unit + theta[0] * theta[1]) / total
            joint.springref = middle * unit
        joint.stiffness = [total, *old[1:]]

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """Its rest is so far away that it would be a constant force."""
        return no_spring(motion.q[:, motion.scene.dof(at.name)], float(theta[1]))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} has a spring of {theta[0]:.3g} {units.stiffness} towards "
            f"{theta[1]:.3g} {units.position} that the model leaves out."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow sweeps of {at.name} over its whole range"
