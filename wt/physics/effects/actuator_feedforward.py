"""A position drive whose firmware adds a force in proportion to how fast its command moves.

With as much as its velocity feedback has, it damps the error's rate and not the joint's: what many
servo drives do, and no ``position`` actuator.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import free_of_limits
from wt.physics.hooks import FromRecordings, OnInputs
from wt.physics.motion import Motion
from wt.physics.replay import Inputs
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class ActuatorFeedforward(FromRecordings, OnInputs):
    """τ += coefficient · (u(t) − u(t − period)) / period, with a command u that is held.

    The period is that of the commands: firmware takes the difference of the last two.
    """

    id = "actuator.feedforward"
    kind = "actuator"
    parameters = (
        Parameter("coefficient", "N·m·s/rad", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("period", "s", 1e-6, 10.0, 0.0, public=False),
    )
    reference = "G. Ellis, Control System Design Guide, 2012, chapter 8 (velocity feed-forward)"
    native = False
    read_off = 1
    signed = (1,)
    excludes = ("actuator.integral",)  # which would sum what is ahead
    looks_like = ("friction by speed",)
    common = "often"
    plotted_over = "velocity"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives that follow a position as it is sent."""
        none = mujoco.mjtDyn.mjDYN_NONE
        return [
            Location("actuator", d.name)
            for d in scene.drives
            if d.bias[1] < 0.0 and scene.model.actuator_dyntype[d.index] == none
        ]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """How long a command lasts, if any follows another."""
        drive = motion.scene.drive(at.name)
        lasting = [_period(motion.command[s.rows, drive.index], s.dt) for s in motion.segments]
        known = [seconds for seconds in lasting if seconds > 0.0]
        # in a recording of steps most commands are sent again: the liveliest one tells
        return [(min(known),)] if known else []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """How fast the command moves, but at the drive's limit."""
        drive = motion.scene.drive(at.name)
        u = motion.u[:, drive.index]
        rate = (u - motion.delayed(drive.index, shape[0])) / shape[0]
        return motion.on(drive.dof, rate * free_of_limits(motion, drive))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficient itself."""
        return np.array([coefficients[0], shape[0]])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Nothing: no actuator of MuJoCo takes the rate of its own command."""

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Move the command by as much as gives that force."""
        drive, (coefficient, period) = scene.drive(at.name), theta
        u = inputs.u[:, drive.index]
        rate = (u - inputs.delayed(u, float(period))) / period
        inputs.u[:, drive.index] = u + coefficient * rate / (drive.gear * drive.gain)

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Remember the commands of one period."""
        coefficient, period = theta
        name = f'"{at.name} commands"'
        force = (
            f'i = self._actuators["{at.name}"]',
            f"k, steps = self.model.actuator_ctrladr[i], max(1, round({number(period)} / h))",
            f"past = self._state({name}, np.tile(ctrl[:, k], (steps, 1)))",
            f"self._next[{name}] = np.concatenate([past[1:], ctrl[None, :, k]])",
            f"more = {number(coefficient)} * (ctrl[:, k] - past[0]) / (steps * h)",
            # a command that is ahead: the drive has its limits, with feed-forward as without
            "ahead = ctrl[:, k] + more / (self.model.actuator_gear[i, 0] * self._gain[i, 0])",
            f'ctrl = self._command("{at.name}", ahead, qpos, qvel, ctrl, f)',
        )
        return Script(force=force, helpers=("given", "command"))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        unit = units.of("N·m·s/rad")
        return (
            f"Actuator {at.name} feeds the velocity of its command forward, by {theta[0]:.3g} "
            f"{unit}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"steps of the command of {at.name}, which kick where velocity is fed forward"


def _period(u: Float[np.ndarray, " sample"], dt: float) -> float:
    """Median time between two changes of a held command [s]; 0 if it changes once at most."""
    changes = np.flatnonzero(np.diff(u))
    return float(np.median(np.diff(changes))) * dt if len(changes) > 1 else 0.0
