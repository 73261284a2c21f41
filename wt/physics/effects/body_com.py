"""A body whose centre of mass lies elsewhere than in the model."""

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

_APART = 0.05  # m; the moments are quadratic in the shift, so any central difference is exact


@register
class BodyCom(Effect):
    """Centre of mass → centre of mass + shift, in the body's frame."""

    id = "body.com"
    kind = "body"
    parameters = (Parameter("shift", "m", -2.0, 2.0, 5e-4, ("x", "y", "z"), neutral=0.0),)
    reference = "C. H. An, C. G. Atkeson and J. M. Hollerbach, Model-Based Control of a Robot, 1988"
    signed = (0, 0, 0)
    looks_like = ("weight",)
    common = "often"

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force per metre of shift along x, y and z."""
        mass, centre, moments = inertia.own(motion.scene, at.name)
        shifted = [
            inertia.parameters(mass, centre + e, moments)
            - inertia.parameters(mass, centre - e, moments)
            for e in _APART * np.eye(3)
        ]
        return -inertia.demand(motion, at.name) @ np.stack(shifted, axis=1) / (2.0 * _APART)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The shift."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Move the body's ``inertial``."""
        weighed(spec, at.name).ipos += theta

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z = 1e3 * theta
        return (
            f"The centre of mass of body {at.name} lies {x:.3g}, {y:.3g}, {z:.3g} mm (x, y, z of "
            "the body) from where the model has it."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"holding still at poses that turn {at.name} about two axes, then fast motions"
