"""A body whose moments of inertia differ from the model's, its mass being right."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics import inertia
from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import weighed
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class BodyInertia(Effect):
    """Moments of inertia about the centre of mass → factor · moments."""

    id = "body.inertia"
    kind = "body"
    odds_against = 4.0
    parameters = (Parameter("factor", "-", 0.01, 20.0, 1e-3, neutral=1.0),)
    reference = "C. H. An, C. G. Atkeson and J. M. Hollerbach, Model-Based Control of a Robot, 1988"
    signed = (0,)
    looks_like = ("inertia",)
    plotted_over = "acceleration"

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force of doubling the moments."""
        _, centre, moments = inertia.own(motion.scene, at.name)
        alone = inertia.parameters(0.0, centre, moments)
        return -(inertia.demand(motion, at.name) @ alone)[:, :, None]

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """One plus the coefficient."""
        return 1.0 + coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Scale the moments of the body's ``inertial``."""
        weighed(spec, at.name).inertia *= theta[0]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Body {at.name} has {100 * theta[0]:.4g} % of its moments of inertia in the model."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"fast turns of {at.name} about each axis beside slow ones, which tell its weight"
