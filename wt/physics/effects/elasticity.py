"""A gear or shaft that twists: the link follows the motor through a spring."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import LEAST, Parameter, register
from wt.physics.motion import Motion
from wt.physics.rotor import LOSSES, GearEffect, split
from wt.physics.script import number
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class Elasticity(GearEffect):
    """τ = stiffness · (rotor − link) + damping · (their speeds' difference)."""

    id = "joint.elasticity"
    plotted_over = "drive"
    excludes = ("joint.backlash",)
    parameters = (
        Parameter("stiffness", "N·m/rad", LEAST, 1e8, 1e-1),
        Parameter("damping", "N·m·s/rad", 0.0, 1e8, 1e-3),
        LOSSES,
    )
    reference = "M. W. Spong, Modeling and control of elastic joint robots, ASME JDSMC 1987"

    def gears(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " _"]]:
        """Twists of 10 to 300 mrad under the largest force, lightly damped; none without force."""
        drive = next(d for d in motion.scene.drives if d.joint == at.name)
        force = float(np.quantile(np.abs(motion.force(drive)), 0.98))
        if force == 0.0:
            return []
        inertia = float(motion.scene.model.dof_M0[drive.dof])
        points = []
        for twist in (0.01, 0.03, 0.1, 0.3):
            stiffness = force / twist
            points.append(np.array([stiffness, 0.1 * np.sqrt(stiffness * inertia)]))
        return points

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """A rotor behind a tendon with stiffness and damping."""
        _, tendon = split(spec, at.name, float(theta[2]))
        tendon.stiffness = [theta[0], 0.0, 0.0]
        tendon.damping = [theta[1], 0.0, 0.0]
        tendon.springlength = [0.0, 0.0]

    def twist(
        self, theta: Float[np.ndarray, " parameter"], force: float, stiffness: float
    ) -> float:
        """As far as the spring balances the drives."""
        return force / (float(theta[0]) + stiffness)

    def twist_line(self, theta: Float[np.ndarray, " parameter"]) -> str:
        """See :meth:`twist`."""
        return f"force / ({number(theta[0])} + stiffness)"

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} is elastic: {theta[0]:.3g} {units.stiffness} between motor and link."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"a chirp on {at.name} through its resonance, and holds under different loads"
