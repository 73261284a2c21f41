"""An encoder with few steps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, register
from wt.physics.hooks import OnOutputs
from wt.physics.replay import Outputs
from wt.physics.replay_only import ReplayOnly
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class SensorQuantization(OnOutputs, ReplayOnly):
    """Recorded position = step · round(true position / step)."""

    id = "sensor.quantization"
    kind = "joint"
    parameters = (Parameter("step", "rad", 1e-6, 1.0, 1e-4, neutral=0.0),)
    reference = "B. Widrow and I. Kollár, Quantization Noise, 2008"
    native = False

    def sense(
        self, outputs: Outputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Report what the encoder makes of the truth."""
        dof = scene.dof(at.name)
        outputs.q[:, dof] = theta[0] * np.round(outputs.q[:, dof] / theta[0])

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """What the encoder reports."""
        column, step = f'q[..., joint("{at.name}")]', number(theta[0])
        return Script(sense=(f"{column} = {step} * np.round({column} / {step})",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        step = f"{1e3 * theta[0]:.3g} m{units.position}"
        said = step if units.slide else f"{step} ({units.distance(theta[0], 2)})"
        return f"The encoder of joint {at.name} has steps of {said}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"very slow sweeps of {at.name}"
