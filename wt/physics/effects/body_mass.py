"""A body that is heavier or lighter than in the model, its mass distributed alike."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics import inertia
from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import weighed
from wt.physics.hooks import Tolerance, Tolerated
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_OFF = 0.02  # standard deviation of a data sheet's mass


@register
class BodyMass(Tolerated):
    """Mass and inertia → factor · mass and inertia."""

    id = "body.mass"
    kind = "body"
    parameters = (Parameter("factor", "-", 0.01, 10.0, 1e-3, neutral=1.0),)
    reference = "C. H. An, C. G. Atkeson and J. M. Hollerbach, Model-Based Control of a Robot, 1988"
    signed = (0,)
    looks_like = ("weight",)
    common = "often"
    at_rest = True

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force of doubling the body."""
        parameters = inertia.parameters(*inertia.own(motion.scene, at.name))
        return -(inertia.demand(motion, at.name) @ parameters)[:, :, None]

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """One plus the coefficient."""
        return 1.0 + coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Scale the body's ``inertial``."""
        body = weighed(spec, at.name)
        body.mass *= theta[0]
        body.inertia *= theta[0]

    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """Every body's."""
        return {Location("body", body): Tolerance(_OFF) for body in scene.moving}

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Body {at.name} has {100 * theta[0]:.4g} % of its mass and inertia in the model."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"a multisine on all joints that carry {at.name}, and weighing it"
