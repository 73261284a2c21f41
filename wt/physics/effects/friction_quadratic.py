"""Friction that grows with the square of speed."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class FrictionQuadratic(Effect):
    """τ = −coefficient · v · |v|."""

    id = "joint.friction_quadratic"
    kind = "joint"
    parameters = (Parameter("coefficient", "N·m·s²/rad²", 0.0, 1e8, 1e-4, neutral=0.0),)
    reference = "MuJoCo XML reference, body/joint/damping (polynomial)"
    signed = (1,)
    looks_like = ("friction by speed",)
    common = "often"
    plotted_over = "velocity"

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−v·|v| on the joint's row."""
        dof = motion.scene.dof(at.name)
        v = motion.v[:, dof]
        return motion.on(dof, -v * np.abs(v))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficient itself."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the second coefficient of the joint's ``damping``."""
        spec.joint(at.name).damping[1] += theta[0]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} is braked by {theta[0]:.3g} {units.force} at 1 {units.speed}, "
            "growing with the square of speed, which the model leaves out."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"constant speeds of {at.name} from slow to the fastest that it reaches"
