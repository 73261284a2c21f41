"""Measurements that arrive late."""

from __future__ import annotations

from collections.abc import Sequence
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
class SensorDelay(Effect):
    """Recorded position at t = true position at t − delay."""

    id = "sensor.delay"
    kind = "joint"
    odds_against = 8.0
    parameters = (Parameter("delay", "s", 0.0, 0.3, 1e-4, neutral=0.0),)
    reference = "J. Olsson et al., Collecting and synchronizing robot data, 2019"
    native = False

    def places(self, scene: Scene) -> Sequence[Location]:
        """All channels together, or one joint's."""
        single = [Location("joint", name) for name in scene.own_joints]
        return [Location("sensor", "all"), *single] if len(single) > 1 else single

    def _dofs(self, scene: Scene, at: Location) -> list[int]:
        return list(range(scene.model.nv)) if at.name == "all" else [scene.dof(at.name)]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """From a quarter of a sample up."""
        return [(f * motion.dt,) for f in (0.25, 0.5, 1.0, 2.0, 4.0)]

    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """How the force residual changes when the sensor errs so."""
        lead = np.zeros_like(motion.q)
        lead[:, self._dofs(motion.scene, at)] = shape[0]
        # true motion at t is the recorded one at t + delay: to second order
        dq = lead * motion.v + 0.5 * lead**2 * motion.a
        dv, da = motion.later(motion.v, lead), motion.later(motion.a, lead)
        return (motion.residual - motion.shifted(dq, dv, da).residual)[:, :, None]

    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """See :meth:`Effect.theta`."""
        return coefficients * shape[0]

    def sense(self, outputs: Outputs, scene: Scene, at: Location, theta: Array) -> None:
        """What the encoder reports."""
        late = outputs.t - theta[0]
        for dof in self._dofs(scene, at):
            q, v = outputs.q[:, dof].copy(), outputs.v[:, dof].copy()
            outputs.q[:, dof] = np.interp(late, outputs.t, q)
            outputs.v[:, dof] = np.interp(late, outputs.t, v)

    def script(self, at: Location, theta: Array) -> Script:
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

    def statement(self, at: Location, theta: Array) -> str:
        """See :meth:`Effect.statement`."""
        whose = "all joints" if at.name == "all" else f"joint {at.name}"
        return f"The measurements of {whose} arrive {1e3 * theta[0]:.3g} ms late."

    def separation(self, at: Location) -> str:
        """See :meth:`Effect.separation`."""
        return f"a fast multisine with a second, synchronous sensor on {at.name}"
