"""A drive that swallows small forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from wt.physics.driving import between, driven, force_of, sides_of
from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import noticeable
from wt.physics.hooks import OnSteps
from wt.physics.live import Law, Live, Values
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units, units_at
from wt.types import Location


@Law
def _swallowed(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    return -between(force_of(own, 0, q, v, u), -theta[0], theta[0])


@register
class ActuatorDeadband(OnSteps):
    """force → force − clip(force, −width, width): nothing inside ±width, that much less outside."""

    id = "actuator.deadband"
    kind = "actuator"
    parameters = (Parameter("width", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),)
    reference = "G. Tao and P. V. Kokotović, Adaptive Control of Systems with Actuator and Sensor "
    reference += "Nonlinearities, 1996"
    native = False
    signed = (1,)
    looks_like = ("weak drive", "offset")
    plotted_over = "drive"
    stiff = True

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Widths that cover 5 to 60 % of the drive's forces."""
        force = np.abs(motion.force(motion.scene.drive(at.name)))
        return [(w,) for w in noticeable(np.quantile(force, [0.05, 0.15, 0.3, 0.6]), force)]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force that the drive swallows."""
        drive = motion.scene.drive(at.name)
        return motion.on(drive.dof, -np.clip(motion.force(drive), -shape[0], shape[0]))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """For forces beyond both, c times what width w swallows is what width c · w swallows."""
        return coefficients * shape[0]

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Take the swallowed force off."""
        return Live(_swallowed, sides_of(scene, at), theta, driven(scene, at))

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Take the swallowed force off."""
        width = number(theta[0])
        force = (
            f'drive, dof = self._drive("{at.name}", qpos, qvel, ctrl)',
            f"f[:, dof] -= np.clip(drive, -{width}, {width})",
        )
        return Script(force=force, helpers=("drive",))

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """The drive's force never leaves it, so that the drive would never have done anything."""
        most = float(np.abs(motion.force(motion.scene.drive(at.name))).max())
        if theta[0] <= most:
            return None
        return (
            f"the drive is never asked for more than {most:.2g} {units_at(motion.scene, at).force}"
        )

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Actuator {at.name} swallows the first {theta[0]:.3g} {units.force} of its force."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow ramps of {at.name} through zero force, which tell a dead band from a gain"
