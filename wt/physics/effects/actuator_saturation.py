"""A drive whose force ends earlier than the model's."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import LEAST, Parameter, Shape, register
from wt.physics.effects._tools import noticeable
from wt.physics.hooks import Limiting
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units, units_at
from wt.physics.usual import smoothed
from wt.types import Location

_OFTEN, _DEMANDED = 0.99, 1.5
"""What is passed for 1 % of the time by half of it is no limit, whatever masses are off by."""


@register
class ActuatorSaturation(Limiting):
    """force → clip(force, −torque, torque)."""

    id = "actuator.saturation"
    kind = "actuator"
    parameters = (Parameter("torque", "N·m", LEAST, 1e8, 1e-3, inexact=0.03),)
    reference = "MuJoCo XML reference, actuator/general/forcerange"
    signed = (1,)
    looks_like = ("weak drive",)
    plotted_over = "drive"

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Torques that the model's drive passes for 2 to 60 % of the time."""
        force = np.abs(motion.force(motion.scene.drive(at.name)))
        return [(t,) for t in noticeable(np.quantile(force, [0.4, 0.6, 0.8, 0.9, 0.98]), force)]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force that the clipped drive lacks; the coefficient of the true torque is 1."""
        drive = motion.scene.drive(at.name)
        force = motion.force(drive)
        return motion.on(drive.dof, np.clip(force, -shape[0], shape[0]) - force)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The torque."""
        return np.array(shape)

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Narrow the actuator's ``forcerange``."""
        narrow(spec, at.name, float(theta[0]))

    def most(self, theta: Float[np.ndarray, " parameter"]) -> float:
        """See :meth:`Limiting.most`."""
        return float(theta[0])

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """The motion takes far more force than that, and no contact may have given it.

        What lasts counts: on a light link noise alone demands that much for a moment.
        """
        drive = motion.scene.drive(at.name)
        free = motion.touching.near == 0
        demand = np.abs(smoothed(motion, motion.demand[:, drive.dof]))[free]
        taken = float(np.quantile(demand, _OFTEN)) if len(demand) else 0.0
        if taken <= _DEMANDED * theta[0]:
            return None
        return f"its joint's motion takes {taken:.2g} {units_at(motion.scene, at).force}"

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Actuator {at.name} gives at most {theta[0]:.3g} {units.force}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"large steps of {at.name} away from the joint's stops, at low speed and at high"


def narrow(spec: mujoco.MjSpec, name: str, torque: float) -> None:
    """Keep an actuator's force on its joint inside ±torque, and inside the range it has."""
    actuator = spec.actuator(name)
    most = torque / abs(actuator.gear[0])
    low, high = -most, most
    limited = actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_TRUE
    automatic = actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_AUTO
    if limited or (automatic and np.any(actuator.forcerange)):
        low, high = max(low, actuator.forcerange[0]), min(high, actuator.forcerange[1])
    actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.forcerange = [low, high]
