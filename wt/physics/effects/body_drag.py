"""Drag of air or water on a body."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.physics.parts import add_body, add_geom, compiled, settle
from wt.physics.units import HINGE, Units
from wt.types import Location

_RADIUS = 0.001  # m, of the sphere that stands for the body in the fluid
_THIN = 1e-6  # kg/m³: so thin that every other body passes through unhindered
_MASS = 1e-6  # kg: MuJoCo leaves bodies without mass out of the fluid


@register
class BodyDrag(Effect):
    """F = −coefficient · |v| · v on the body's centre of mass, v in the world's frame."""

    id = "body.drag"
    kind = "body"
    odds_against = 8.0
    parameters = (Parameter("coefficient", "N·s²/m²", 0.0, 1e8, 1e-3, neutral=0.0),)
    reference = "MuJoCo documentation, computation/fluid (ellipsoid model, blunt drag)"
    signed = (1,)
    plotted_over = "velocity"

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−|v|·v at the centre of mass."""
        point = motion.point(at.name)
        speed = np.linalg.norm(point.velocity, axis=1, keepdims=True)
        return point.generalised(-speed * point.velocity)[:, :, None]

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficient."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Weld on a tiny sphere that alone feels the fluid, by a large drag coefficient.

        A sphere drags alike along every axis. A model without a fluid gets one so thin that its
        other bodies lose less than a millionth of a newton.
        """
        if theta[0] <= 0.0:
            return
        settle(spec)
        name, com = f"{at.name}_drag", compiled(spec).body(at.name).ipos
        density = float(spec.option.density) or _THIN
        spec.option.density = density
        buoy = add_body(spec, spec.body(at.name), name, pos=com)
        # without a position MuJoCo would not write the inertia into the file
        buoy.explicitinertial, buoy.mass, buoy.ipos = True, _MASS, np.zeros(3)
        buoy.inertia = np.full(3, 0.4 * _MASS * _RADIUS**2)
        sphere = add_geom(spec, buoy, name, size=[_RADIUS, 0.0, 0.0], mass=_MASS)
        sphere.contype, sphere.conaffinity = 0, 0
        sphere.fluid_ellipsoid = 1
        # MuJoCo's drag is density · blunt · π·r² · |v| · v, without the usual ½
        sphere.fluid_coefs = [theta[0] / (density * np.pi * _RADIUS**2), 0.0, 0.0, 0.0, 0.0]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Drag holds {at} back with {theta[0]:.3g} N at 1 m/s, growing with speed squared."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"long fast sweeps that move {at.name} at several speeds, joints one by one"
