"""Play in a gear: the motor turns a little before the link follows."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, register
from wt.physics.motion import Motion
from wt.physics.rotor import LOSSES, GearEffect, split
from wt.physics.script import number
from wt.physics.units import HINGE, Units, units_at
from wt.types import Location

_CONTACT = 0.002
"""Time constant of the teeth's contact [s]: far faster than what a recording shows."""


@register
class Backlash(GearEffect):
    """No torque passes while |rotor − link| < gap / 2; the teeth are stiff beyond."""

    id = "joint.backlash"
    plotted_over = "drive"
    excludes = ("joint.elasticity",)
    parameters = (Parameter("gap", "rad", 1e-4, 1.0, 2e-4, neutral=0.0), LOSSES)
    reference = "M. Nordin and P.-O. Gutman, Controlling mechanical systems with backlash, 2002"
    looks_like = ("offset",)

    def gears(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " _"]]:
        """From 0.2° to 4°."""
        return [np.array([gap]) for gap in (0.004, 0.015, 0.06)]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """A rotor behind a tendon that is free inside its limits.

        Limits push and damp only where the teeth touch, and are stable at any time step; damping
        of the tendon itself would brake the rotor inside the gap as well.
        """
        _, tendon = split(spec, at.name, float(theta[1]))
        tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        tendon.range = [-0.5 * theta[0], 0.5 * theta[0]]
        tendon.solref_limit = [_CONTACT, 1.0]

    def twist(
        self, theta: Float[np.ndarray, " parameter"], force: float, stiffness: float
    ) -> float:
        """As far as the drives turn the rotor, or to the teeth."""
        half = 0.5 * float(theta[0])
        free = force / stiffness if stiffness else np.copysign(np.inf, force)
        return float(np.clip(free, -half, half))

    def twist_line(self, theta: Float[np.ndarray, " parameter"]) -> str:
        """See :meth:`twist`."""
        half = number(0.5 * theta[0])
        return f"np.clip(force / max(stiffness, 1e-9), -{half}, {half})"

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """The joint never moves as far as the play is wide: nothing would have driven it."""
        moved = float(np.ptp(motion.q[:, motion.scene.dof(at.name)]))
        if theta[0] <= moved:
            return None
        said = units_at(motion.scene, at).distance(moved, 2)
        return f"the joint moves by no more than {said} in all"

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Joint {at.name} has {units.distance(theta[0], 2)} of gear play."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"small reversals of {at.name} under little load, slow and fast"
