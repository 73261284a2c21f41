"""Measurements that arrive late."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import OnOutputs, Tolerance, Tolerated
from wt.physics.motion import Motion
from wt.physics.replay import Outputs
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_OFF = 1e-3  # s: encoders and what tracks a base are two systems with two clocks


@register
class SensorDelay(OnOutputs, Tolerated):
    """Recorded position at t = true position at t − delay."""

    id = "sensor.delay"
    kind = "joint"
    odds_against = 8.0
    parameters = (Parameter("delay", "s", 0.0, 0.3, 1e-4, neutral=0.0),)
    reference = "J. Olsson et al., Collecting and synchronizing robot data, 2019"
    native = False
    looks_like = ("delay",)
    plotted_over = "velocity"
    correctable = False

    def places(self, scene: Scene) -> Sequence[Location]:
        """All channels together, or one joint's."""
        single = [Location("joint", name) for name in scene.own_joints]
        return [Location("sensor", "all"), *single] if len(single) > 1 else single

    def same_as(self, scene: Scene, at: Location) -> Sequence[tuple[str, Location]]:
        """Late commands, where all measurements are late: only the time between them shows."""
        drives = [Location("actuator", drive.name) for drive in scene.drives]
        if scene.free or not drives or len(self._dofs(scene, at)) < scene.model.nv:
            return ()
        return [("actuator.delay", Location("actuator", "all") if len(drives) > 1 else drives[0])]

    def _dofs(self, scene: Scene, at: Location) -> list[int]:
        return list(range(scene.model.nv)) if at.name == "all" else [scene.dof(at.name)]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """From a quarter of a sample up."""
        return [(f * motion.dt,) for f in (0.25, 0.5, 1.0, 2.0, 4.0)]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Change of the force residual when the sensor errs so."""
        lead = np.zeros_like(motion.q)
        lead[:, self._dofs(motion.scene, at)] = shape[0]
        # true motion at t is the recorded one at t + delay: to second order
        dq = lead * motion.v + 0.5 * lead**2 * motion.a
        dv, da = motion.later(motion.v, lead), motion.later(motion.a, lead)
        return (motion.residual - motion.shifted(dq, dv, da).residual)[:, :, None]

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """See :meth:`Effect.theta`."""
        return coefficients * shape[0]

    def sense(
        self, outputs: Outputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Report what the encoder makes of the truth."""
        t, late = outputs.t, outputs.t - theta[0]
        began = np.minimum(late - t[0], 0.0)
        for dof in self._dofs(scene, at):
            q, v = outputs.q[:, dof].copy(), outputs.v[:, dof].copy()
            if len(t) > 1:  # straight lines between samples would err by more than late commands do
                motion = CubicHermiteSpline(t, q, v)
                outputs.q[:, dof], outputs.v[:, dof] = motion(late - began), motion(late - began, 1)
            # before the first sample the motion went on as it begins
            outputs.q[:, dof] += began * v[0]

    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """All channels together, against what tracks a floating base."""
        return {Location("sensor", "all"): Tolerance(_OFF)} if scene.free else {}

    def small(self, motion: Motion, at: Location, size: float) -> Float[np.ndarray, "sample dof"]:
        """Force of a delay of that size: it is the shape, with coefficient one."""
        return np.asarray(self.columns(motion, at, (size,))[:, :, 0])

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """What the encoder reports; before the first sample the motion went on as it begins."""
        delay = number(theta[0])
        every = "range(len(self.joints))" if at.name == "all" else f'[joint("{at.name}")]'
        sense = (
            f"late = np.asarray(t, dtype=float) - {delay}",
            f"for k in {every}:",
            "    before = np.minimum(late - t[0], 0.0) * v[0, k]",
            "    q[:, k] = np.interp(late, t, q[:, k]) + before",
            "    v[:, k] = np.interp(late, t, v[:, k])",
        )
        undo = (f"for k in {every}:", f"    q[..., k] += {delay} * v[..., k]")
        return Script(sense=sense, undo=undo)

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        whose = "all joints" if at.name == "all" else f"joint {at.name}"
        return f"The measurements of {whose} arrive {1e3 * theta[0]:.3g} ms late."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"a fast multisine with a second, synchronous sensor on {at.name}"
