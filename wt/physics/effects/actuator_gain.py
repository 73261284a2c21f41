"""A drive whose whole force is scaled."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import free_of_limits
from wt.physics.hooks import Tolerance, Tolerated
from wt.physics.motion import Motion
from wt.physics.parts import settle
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_OFF = 0.01  # standard deviation of a drive's strength


@register
class ActuatorGain(Tolerated):
    """force → factor · force, inside the model's force range."""

    id = "actuator.gain"
    kind = "actuator"
    parameters = (Parameter("factor", "-", 0.0, 100.0, 1e-3, neutral=1.0),)
    reference = "MuJoCo XML reference, actuator/general/gainprm and biasprm"
    signed = (0,)
    looks_like = ("weak drive", "offset")
    common = "always"
    plotted_over = "drive"
    at_rest = True

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """The drive's force, except where it is at its limit."""
        drive = motion.scene.drive(at.name)
        force = motion.force(drive) * free_of_limits(motion, drive)
        return motion.on(drive.dof, force)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """One plus the coefficient."""
        return 1.0 + coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Scale ``gainprm`` and ``biasprm``; of a ``pid``, that has kp, and ``gainprm`` its ki."""
        settle(spec)
        actuator = spec.actuator(at.name)
        if actuator.gaintype != mujoco.mjtGain.mjGAIN_PID:
            actuator.gainprm[:3] *= theta[0]
        actuator.biasprm[:3] *= theta[0]

    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """Every drive's."""
        return {Location("actuator", drive.name): Tolerance(_OFF) for drive in scene.drives}

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Actuator {at.name} delivers {100 * theta[0]:.4g} % of the force in the model."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"steps and slow motions of the joint of {at.name} under different loads"
