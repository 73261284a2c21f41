"""An encoder whose zero is elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.types import Location

if TYPE_CHECKING:
    from wt.physics.replay import Outputs

Array = np.ndarray


@register
class SensorOffset(Effect):
    """Recorded position = true position + offset."""

    id = "sensor.offset"
    kind = "joint"
    odds_against = 8.0
    parameters = (Parameter("offset", "rad", -3.2, 3.2, 1e-4, neutral=0.0),)
    reference = "B. Mooring, Z. Roth and M. Driels, Fundamentals of Manipulator Calibration, 1991"
    native = False

    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """How the force residual changes when the sensor errs so."""
        dof = motion.scene.dof(at.name)
        size = 1e-3
        moved = np.zeros_like(motion.q)
        moved[:, dof] = -size
        return (motion.residual - motion.shifted(moved).residual)[:, :, None] / size

    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """See :meth:`Effect.theta`."""
        return coefficients

    def sense(self, outputs: Outputs, scene: Scene, at: Location, theta: Array) -> None:
        """What the encoder reports."""
        outputs.q[:, scene.dof(at.name)] += theta[0]

    def script(self, at: Location, theta: Array) -> Script:
        """What the encoder reports."""
        column, offset = f'q[..., joint("{at.name}")]', number(theta[0])
        return Script(sense=(f"{column} += {offset}",), undo=(f"{column} -= {offset}",))

    def statement(self, at: Location, theta: Array) -> str:
        """See :meth:`Effect.statement`."""
        return f"The encoder of joint {at.name} reads {np.degrees(theta[0]):.3g}° too much."

    def separation(self, at: Location) -> str:
        """See :meth:`Effect.separation`."""
        return f"holds of {at.name} under gravity, with its neighbours in several poses"
