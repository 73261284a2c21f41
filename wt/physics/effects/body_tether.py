"""A spring that ties a body to a point of the world."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import Linearised
from wt.physics.motion import Motion
from wt.physics.parts import add_site, add_tendon
from wt.physics.units import HINGE, Units
from wt.types import Location

_FAR = 4.0
"""The farthest anchor that a signature may say [m]: within the bounds, or the pull is lost."""


@register
class BodyTether(Linearised):
    """F = stiffness · (anchor − x) on the origin x of the body's frame."""

    id = "body.tether"
    kind = "body"
    parameters = (
        Parameter("stiffness", "N/m", 0.0, 1e8, 1e-1),
        Parameter("anchor", "m", -5.0, 5.0, 1e-3, ("x", "y", "z")),
    )
    reference = "R. Hooke, De potentia restitutiva, 1678"
    signed = (1, 0, 0, 0)
    looks_like = ("pull",)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Per unit of k, and of k times each coordinate of the anchor."""
        point = motion.point(at.name, (0.0, 0.0, 0.0))
        pull = point.generalised(-point.x)
        return np.concatenate([pull[:, :, None], np.swapaxes(point.jacobian, 1, 2)], axis=2)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """(stiffness, anchor); a pull that does not change comes from far away."""
        pull = float(np.abs(coefficients[1:]).max())
        k = max(float(coefficients[0]), pull / _FAR, 1e-6)
        return np.array([k, *(coefficients[1:] / k)])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """A spatial tendon of no rest length between a site on the body and one in the world."""
        near, far = f"{at.name}_tether", f"{at.name}_anchor"
        add_site(spec, spec.body(at.name), near)
        add_site(spec, spec.worldbody, far, pos=theta[1:])
        stiffness = [theta[0], 0.0, 0.0]
        tendon = add_tendon(spec, near, stiffness=stiffness, springlength=[0.0, 0.0])
        tendon.wrap_site(near)
        tendon.wrap_site(far)

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z = theta[1:]
        return (
            f"Body {at.name} is tied to the point ({x:.3g}, {y:.3g}, {z:.3g}) m of the world by "
            f"{theta[0]:.3g} N/m."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow moves of {at.name} through the whole workspace"
