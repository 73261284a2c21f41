"""Rotor inertia that the model lacks, or has too much of.

A rotor's inertia at the joint goes with the square of the gear's ratio, and is published for one of
a servo's several gears, or fitted by somebody to something else. Only what the model has of it can
be too much: a machine without any has a light gear, and none is lighter.
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
from wt.physics.rotor import motor
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_OFF = 0.03  # of the whole inertia: half the rotor's is rarely published


@register
class Armature(OrLess, Tolerated):
    """τ = −inertia · a."""

    id = "joint.armature"
    kind = "joint"
    parameters = (Parameter("inertia", "kg·m²", 0.0, 1e8, 1e-4, neutral=0.0),)
    reference = "R. Featherstone, Rigid Body Dynamics Algorithms, 2008, section 9.6"
    signed = (1,)
    looks_like = ("inertia",)
    plotted_over = "acceleration"

    def has(self, scene: Scene, at: Location) -> float:
        """The joint's ``armature``."""
        return float(scene.model.dof_armature[scene.dof(at.name)])

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−a on the joint's row."""
        dof = motion.scene.dof(at.name)
        return motion.on(dof, -motion.a[:, dof])

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """See :meth:`Effect.theta`."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the joint's ``armature``, which is its rotor's where that has a joint."""
        motor(spec, at.name).armature += theta[0]

    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """A share of the whole inertia, of which no more can be missing than the rotor's own."""
        m = scene.model
        return {
            Location("joint", joint): Tolerance(
                _OFF * float(m.dof_M0[dof]), -float(m.dof_armature[dof])
            )
            for joint, dof in ((joint, scene.dof(joint)) for joint in scene.own_joints)
        }

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        unit, what = units.of("kg·m²"), "moving mass" if units.slide else "rotor inertia"
        how = "less" if theta[0] < 0.0 else "more"
        return f"Joint {at.name} has {abs(theta[0]):.3g} {unit} {how} {what} than the model."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"fast small oscillations of {at.name}"
