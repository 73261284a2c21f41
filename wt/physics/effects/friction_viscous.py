"""Friction in proportion to speed, that the model lacks or has too much of.

Dampers of a model are often guesses, made so that it does not tremble. Only what the model has of
them can be too much.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import Tolerance, Tolerated
from wt.physics.less import OrLess
from wt.physics.motion import Motion
from wt.physics.rotor import braked
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_OFF = 0.1  # standard deviation of a model's damping, as a share


@register
class FrictionViscous(OrLess, Tolerated):
    """τ = −coefficient · v."""

    id = "joint.friction_viscous"
    kind = "joint"
    parameters = (Parameter("coefficient", "N·m·s/rad", 0.0, 1e8, 1e-4, neutral=0.0),)
    reference = "G. G. Stokes, Transactions of the Cambridge Philosophical Society 9, 1851"
    signed = (1,)
    looks_like = ("friction by speed",)
    common = "always"
    plotted_over = "velocity"

    def has(self, scene: Scene, at: Location) -> float:
        """The linear part of the joint's ``damping``."""
        return float(scene.model.dof_damping[scene.dof(at.name)])

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−v on the joint's row."""
        dof = motion.scene.dof(at.name)
        return motion.on(dof, -motion.v[:, dof])

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficient itself."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the joint's ``damping``, its linear part, where the model has it."""
        for part, share in braked(spec, at.name):
            part.damping[0] += share * theta[0]

    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """A share of the damping that the model has, where it has any."""
        damping = {j: float(scene.model.dof_damping[scene.dof(j)]) for j in scene.own_joints}
        return {Location("joint", j): Tolerance(_OFF * d) for j, d in damping.items() if d > 0.0}

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        unit = units.of("N·m·s/rad")
        if theta[0] < 0.0:
            size = f"{-theta[0]:.3g} {unit}"
            return f"Joint {at.name} has {size} less viscous friction than the model."
        return f"Joint {at.name} has {theta[0]:.3g} {unit} of viscous friction not in the model."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"a multisine on {at.name}, which tells friction from a few milliseconds of delay"
