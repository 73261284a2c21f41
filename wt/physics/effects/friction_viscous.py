"""Friction in proportion to speed."""

from __future__ import annotations

import mujoco
import numpy as np

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.types import Location

Array = np.ndarray


@register
class FrictionViscous(Effect):
    """τ = −coefficient · v."""

    id = "joint.friction_viscous"
    kind = "joint"
    parameters = (Parameter("coefficient", "N·m·s/rad", 0.0, 1e3, 1e-4, neutral=0.0),)
    reference = "G. G. Stokes, Transactions of the Cambridge Philosophical Society 9, 1851"
    signed = (1,)

    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """−v on the joint's row."""
        dof = motion.scene.dof(at.name)
        return motion.on(dof, -motion.v[:, dof])

    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """The coefficient itself."""
        return coefficients

    def patch(self, spec: mujoco.MjSpec, at: Location, theta: Array) -> None:
        """Add to the joint's ``damping``, its linear part."""
        spec.joint(at.name).damping[0] += theta[0]

    def statement(self, at: Location, theta: Array) -> str:
        """See :meth:`Effect.statement`."""
        return f"Joint {at.name} has {theta[0]:.3g} N·m·s/rad of viscous friction not in the model."

    def separation(self, at: Location) -> str:
        """See :meth:`Effect.separation`."""
        return f"a multisine on {at.name}, which tells friction from a few milliseconds of delay"
