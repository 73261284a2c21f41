"""A drive whose force falls with speed, like a motor's at full voltage."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.driving import between, driven, force_of, sides_of
from wt.physics.effect import LEAST, Parameter, Shape, register
from wt.physics.effects.actuator_saturation import narrow
from wt.physics.hooks import Intervals, Nested, OnSteps
from wt.physics.live import Figures, Law, Live, Values, in_laws
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location


@Law
def _lacking(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    force = force_of(own, 0, q, v, u)
    return _limited(force, v[dof], theta[0], theta[1]) - force


_FLAT = 0.02
"""A limit that falls by less than this share up to the fastest motion is the same at all speeds."""


@register
class ActuatorSpeedLimit(Nested, OnSteps):
    """force → clip(force, −stall · (1 + v/speed), stall · (1 − v/speed))."""

    id = "actuator.speed_limit"
    kind = "actuator"
    parameters = (
        Parameter("stall", "N·m", LEAST, 1e8, 1e-3, inexact=0.03),
        Parameter("speed", "rad/s", LEAST, 1e6, 1e-3, inexact=0.03),
    )
    reference = "A. Hughes and B. Drury, Electric Motors and Drives, 2019, chapter 3"
    native = False
    signed = (1,)
    plotted_over = "velocity"

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Stall torques around the largest force, no-load speeds around the fastest motion."""
        drive = motion.scene.drive(at.name)
        force = float(np.quantile(np.abs(motion.force(drive)), 0.99))
        fastest = float(np.abs(motion.v[:, drive.dof]).max())
        tried = [(s * force, f * fastest) for s in (0.7, 1.0, 2.0) for f in (0.9, 1.3, 2.0, 4.0)]
        return tried if force > 0.0 and fastest > 0.0 else []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force that the drive lacks; the coefficient of the true limits is 1."""
        drive = motion.scene.drive(at.name)
        force = motion.force(drive)
        limited = _limited(force, motion.v[:, drive.dof], *shape)
        return motion.on(drive.dof, limited - force)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Stall torque and no-load speed."""
        return np.array(shape)

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Saturation, where the limit may be the same at all speeds that were seen."""
        fastest = float(np.abs(motion.v[:, motion.scene.drive(at.name).dof]).max())
        if fastest > _FLAT * np.max(intervals["speed"][1]):
            return None
        return "actuator.saturation", theta[:1]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Stand-in: ``forcerange`` of the stall torque, right at standstill."""
        narrow(spec, at.name, float(theta[0]))

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Clip the force at every step."""
        return Live(_lacking, sides_of(scene, at), theta, driven(scene, at))

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Clip the force at every step."""
        stall, speed = map(number, theta)
        force = (
            f'drive, dof = self._drive("{at.name}", qpos, qvel, ctrl)',
            f"share = qvel[:, dof] / {speed}",
            f"limited = np.clip(drive, -{stall} * (1 + share), {stall} * (1 - share))",
            "f[:, dof] += limited - drive",
        )
        return Script(force=force, helpers=("drive",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Actuator {at.name} gives at most {theta[0]:.3g} {units.force} at standstill, and "
            f"less with speed until nothing is left at {theta[1]:.3g} {units.speed}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"full-force accelerations of {at.name} in both directions up to its top speed"


@in_laws
def _limited(force: Figures, v: Figures, stall: float, speed: float) -> Figures:
    return between(force, -stall * (1.0 + v / speed), stall * (1.0 - v / speed))
