"""Dry friction that grows with the force in the gear."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.physics.driving import all_drives, force_of_all
from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._bristle import BRISTLE, WithDryFriction, brake
from wt.physics.effects._tools import mean_weight
from wt.physics.hooks import Intervals, Nested
from wt.physics.live import Law, Values
from wt.physics.motion import Motion
from wt.physics.parts import compiled
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_NEGLIGIBLE = 0.05  # share of the constant part that the load must add to count


@Law
def _loaded(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    load = force_of_all(own, BRISTLE, q, v, u)
    return brake(theta[0] + theta[1] * abs(load), v[dof], h, own)


@register
class FrictionLoad(Nested, WithDryFriction):
    """τ = −sign(v) · (coulomb + fraction · |drive force|), with the force before friction."""

    id = "joint.friction_load"
    kind = "joint"
    law = _loaded
    parameters = (
        Parameter("coulomb", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("fraction", "-", 0.0, 1.0, 1e-3, neutral=0.0),
    )
    reference = "M. Duclusaud et al., Extended friction models for servo actuators, ICRA 2025"
    native = False
    unites = ("joint.friction_coulomb", "joint.friction_load")
    signed = (1, 1)
    looks_like = ("dry friction",)
    plotted_over = "velocity"

    def needs(
        self, scene: Scene, dofs: Int[np.ndarray, " place"]
    ) -> Float[np.ndarray, "place figure"]:
        """All drives of each joint."""
        return all_drives(scene, dofs)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−sign(v) and −sign(v)·|drive force|."""
        dof = motion.scene.dof(at.name)
        sign = np.sign(motion.v[:, dof])
        return motion.on(dof, -sign, -sign * np.abs(motion.drive_forces[:, dof]))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Constant part and fraction of the load."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Stand-in: ``frictionloss`` of the friction under the mean weight over one turn."""
        load = mean_weight(compiled(spec), at.name)
        spec.joint(at.name).frictionloss += theta[0] + theta[1] * load

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse what is plain dry friction: the load adds next to nothing."""
        return bool(theta[1] * _load(motion, at) > _NEGLIGIBLE * theta[0])

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Coulomb's, where the load may add nothing."""
        if np.min(intervals["fraction"][0]) > 0.0:
            return None
        return "joint.friction_coulomb", theta[:1] + theta[1] * _load(motion, at)

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Friction by an elastic bristle that slips."""
        coulomb, fraction = map(number, theta)
        level = (
            f'load = np.abs(self._drives("{at.name}", qpos, qvel, ctrl))',
            f"level = {coulomb} + {fraction} * load",
        )
        return self.slipping(at, level, "drives")

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} loses {theta[0]:.3g} {units.force} and {100 * theta[1]:.3g} % of its "
            "drive's force to dry friction."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow reversals of {at.name} under several loads, e.g. with the arm out and folded"


def _load(motion: Motion, at: Location) -> float:
    """Mean size of the force of a joint's drives [N·m]."""
    return float(np.abs(motion.drive_forces[:, motion.scene.dof(at.name)]).mean())
