"""A drive that weakens as it warms up."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import DriveLaw
from wt.physics.live import Live
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.types import Location

Array = np.ndarray


@register
class ActuatorFade(Effect):
    """τ → τ · (1 − loss · (1 − exp(−t / time_constant)))."""

    id = "actuator.fade"
    kind = "actuator"
    parameters = (
        Parameter("loss", "-", 0.0, 0.95, 1e-3),
        Parameter("time_constant", "s", 2.0, 1e4, 1e-2),
    )
    reference = "J. Pyrhönen et al., Design of Rotating Electrical Machines, chapter 9"
    native = False
    signed = (1,)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Fractions of the recording's length."""
        last = float(motion.t.max())
        return [(f * last,) for f in (0.1, 0.25, 0.5, 1.0, 2.0)]

    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """The force that is lost, per unit of final loss."""
        drive = motion.scene.drive(at.name)
        return motion.on(drive.dof, -motion.force(drive) * (1.0 - np.exp(-motion.t / shape[0])))

    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """(loss, time constant)."""
        return np.array([coefficients[0], shape[0]])

    def patch(self, spec: mujoco.MjSpec, at: Location, theta: Array) -> None:
        """The final strength as gain: the closest that a servo's element offers."""
        actuator = spec.actuator(at.name)
        actuator.gainprm = np.array(actuator.gainprm) * (1.0 - theta[0])
        actuator.biasprm = np.array(actuator.biasprm) * (1.0 - theta[0])

    def model(self, spec: mujoco.MjSpec, at: Location, theta: Array) -> None:
        """Nothing: the replay computes the force at every step."""

    def live(self, scene: Scene, at: Location, theta: Array) -> Live:
        """Take the lost force off."""
        loss, tau = theta.T
        return DriveLaw(
            scene, at.name, lambda force, v, t: force * (1.0 - loss * (1.0 - np.exp(-t / tau)))
        )

    def statement(self, at: Location, theta: Array) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Actuator {at.name} loses {100.0 * theta[0]:.3g} % of its strength as it warms up, "
            f"with a time constant of {theta[1]:.3g} s."
        )

    def separation(self, at: Location) -> str:
        """See :meth:`Effect.separation`."""
        return f"the same motion of {at.name} from cold, repeated for several minutes"
