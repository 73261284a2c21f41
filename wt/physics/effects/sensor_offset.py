"""An encoder whose zero is elsewhere."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import OnOutputs
from wt.physics.motion import Motion
from wt.physics.replay import Outputs
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class SensorOffset(OnOutputs):
    """Recorded position = true position + offset."""

    id = "sensor.offset"
    kind = "joint"
    odds_against = 8.0
    parameters = (Parameter("offset", "rad", -3.2, 3.2, 1e-4, neutral=0.0),)
    reference = "B. Mooring, Z. Roth and M. Driels, Fundamentals of Manipulator Calibration, 1991"
    native = False
    looks_like = ("offset",)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Change of the force residual when the sensor errs so."""
        dof = motion.scene.dof(at.name)
        size = 1e-3
        moved = np.zeros_like(motion.q)
        moved[:, dof] = -size
        return (motion.residual - motion.shifted(moved).residual)[:, :, None] / size

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """See :meth:`Effect.theta`."""
        return coefficients

    def sense(
        self, outputs: Outputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Report what the encoder makes of the truth."""
        outputs.q[:, scene.dof(at.name)] += theta[0]

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """What the encoder reports."""
        column, offset = f'q[..., joint("{at.name}")]', number(theta[0])
        return Script(sense=(f"{column} += {offset}",), undo=(f"{column} -= {offset}",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        off, way = abs(float(theta[0])), "much" if theta[0] > 0.0 else "little"
        return f"The encoder of joint {at.name} reads {units.distance(off)} too {way}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"holds of {at.name} under gravity, with its neighbours in several poses"
