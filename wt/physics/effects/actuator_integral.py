"""A position drive whose loop has integral action: it leans on what it has not reached for long."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import Remembering
from wt.physics.motion import Motion
from wt.physics.replay import Stretch
from wt.physics.scene import Scene
from wt.physics.servos import as_pid, gain, integral, servos, swing
from wt.physics.units import HINGE, Units
from wt.types import Location

_SWINGS = 0.1
"""Share of its force on the mean that integral action swings by: what swings less is a bias."""


@register
class ActuatorIntegral(Remembering):
    """τ += ki · ∫(u / gear − q) dt, from whatever it had come to when the recording began."""

    id = "actuator.integral"
    kind = "actuator"
    parameters = (Parameter("ki", "N·m/(rad·s)", 0.0, 1e8, 1e-2, neutral=0.0),)
    reference = "MuJoCo XML reference, actuator/pid/ki"
    signed = (1,)
    excludes = ("actuator.lag",)
    looks_like = ("offset",)
    plotted_over = "time"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives that follow a position as it is sent."""
        return servos(scene)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Integral of the position error, from what the forces say that it began with.

        But for its mean where they say that it is no integral: any constant would be one.
        """
        dof, seen = motion.scene.drive(at.name).dof, gain(motion, at.name)
        known = seen > 0.0 and self.plausible(motion, at, np.array([seen]))
        return motion.on(dof, integral(motion, at.name, seen) if known else swing(motion, at.name))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The gain itself."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """``ki`` of a ``pid`` actuator."""
        if theta[0] > 0.0:
            actuator = as_pid(spec, at.name)
            actuator.gainprm[0] = theta[0] / actuator.gear[0] ** 2

    def remembered(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, float]:
        """The integral, of the actuator's length."""
        if theta[0] <= 0.0:
            return {}
        motion, segment, x = stretch.motion, stretch.segment, 0.0
        if motion is not None and segment is not None:
            total = integral(motion, at.name, float(theta[0]))[segment.rows]
            x = float(np.interp(stretch.t[0], motion.t[segment.rows], total))
            x *= motion.scene.drive(at.name).gear
        return {f"{at.name} integral": x}

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """What hardly swings is a constant, which a bias says as well."""
        mean = integral(motion, at.name, float(theta[0])) - swing(motion, at.name)
        return bool(np.std(swing(motion, at.name)) > _SWINGS * np.abs(mean).max())

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Actuator {at.name} has integral action: {theta[0]:.3g} "
            f"{units.of('N·m/(rad·s)')} of its position error."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"poses of {at.name} held for seconds under load, which integral action creeps to"
