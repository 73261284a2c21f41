"""Velocity feedback of a position drive that the robot has less of than the model.

What a drive damps more is viscous friction for all that a joint tells; only less is told apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import free_of_limits
from wt.physics.motion import Motion
from wt.physics.parts import settle
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class ActuatorDamping(Effect):
    """The part −kv · v of a drive's force → factor · that part."""

    id = "actuator.damping"
    kind = "actuator"
    parameters = (Parameter("factor", "-", 0.0, 1.0, 1e-3, neutral=1.0),)
    reference = "MuJoCo XML reference, actuator/position/kv"
    signed = (1,)
    looks_like = ("friction by speed",)
    common = "often"
    plotted_over = "velocity"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives that feed back position and velocity."""
        return [
            Location("actuator", d.name)
            for d in scene.drives
            if d.bias[1] < 0.0 and d.bias[2] < 0.0
        ]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """What the drive would push more with no velocity feedback, but at its limit."""
        drive = motion.scene.drive(at.name)
        damping = drive.gear**2 * drive.bias[2] * motion.v[:, drive.dof]
        return motion.on(drive.dof, -damping * free_of_limits(motion, drive))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """One less the coefficient."""
        return 1.0 - coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Scale the velocity part of ``biasprm``."""
        settle(spec)
        spec.actuator(at.name).biasprm[2] *= theta[0]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Actuator {at.name} feeds back {100 * theta[0]:.3g} % of the velocity that it does "
            "in the model."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"the joint of {at.name} moved by hand with its drive off, and then on"
