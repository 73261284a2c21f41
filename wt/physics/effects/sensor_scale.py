"""An encoder that reads a multiple of the truth."""

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
class SensorScale(OnOutputs):
    """Recorded position (and velocity) = factor · true."""

    id = "sensor.scale"
    kind = "joint"
    odds_against = 8.0
    parameters = (Parameter("factor", "-", 0.1, 10.0, 1e-4, neutral=1.0),)
    reference = "B. Mooring, Z. Roth and M. Driels, Fundamentals of Manipulator Calibration, 1991"
    native = False

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Change of the force residual when the sensor errs so."""
        dof = motion.scene.dof(at.name)
        size = 1e-3
        dq, dv, da = (np.zeros_like(motion.q) for _ in range(3))
        dq[:, dof] = -size * motion.q[:, dof]
        dv[:, dof] = -size * motion.v[:, dof]
        da[:, dof] = -size * motion.a[:, dof]
        return (motion.residual - motion.shifted(dq, dv, da).residual)[:, :, None] / size

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """See :meth:`Effect.theta`."""
        return 1.0 + coefficients

    def sense(
        self, outputs: Outputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Report what the encoder makes of the truth."""
        dof = scene.dof(at.name)
        outputs.q[:, dof] *= theta[0]
        outputs.v[:, dof] *= theta[0]

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """What the encoder reports."""
        columns, factor = [f'{x}[..., joint("{at.name}")]' for x in "qv"], number(theta[0])
        return Script(
            sense=tuple(f"{x} *= {factor}" for x in columns),
            undo=tuple(f"{x} /= {factor}" for x in columns),
        )

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"The encoder of joint {at.name} reads {100.0 * theta[0]:.4g} % of the true position."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow sweeps of {at.name} over its whole range, against a second sensor"
