"""Dry friction of constant size against the motion, that the model lacks or has too much of."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import add_dry_friction
from wt.physics.less import OrLess
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class FrictionCoulomb(OrLess):
    """τ = −coulomb · sign(v)."""

    id = "joint.friction_coulomb"
    kind = "joint"
    parameters = (Parameter("coulomb", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),)
    reference = "C. A. Coulomb, Théorie des machines simples, 1785"
    signed = (1,)
    looks_like = ("dry friction",)
    common = "always"
    plotted_over = "velocity"

    def has(self, scene: Scene, at: Location) -> float:
        """The joint's ``frictionloss``."""
        return float(scene.model.dof_frictionloss[scene.dof(at.name)])

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−sign(v) on the joint's row."""
        dof = motion.scene.dof(at.name)
        return motion.on(dof, -np.sign(motion.v[:, dof]))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficient is the friction torque."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the joint's ``frictionloss``, or take from it, which leaves how that creeps."""
        if theta[0] > 0.0:
            add_dry_friction(spec, at.name, float(theta[0]))
        else:
            element = spec.joint(at.name)
            element.frictionloss = max(0.0, element.frictionloss + float(theta[0]))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        if theta[0] < 0.0:
            size = f"{-theta[0]:.3g} {units.force}"
            return f"Joint {at.name} loses {size} less to dry friction than the model says."
        return (
            f"Joint {at.name} loses {theta[0]:.3g} {units.force} to dry friction that the model "
            "leaves out."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow reversals of {at.name} at several speeds, with the rest held still"


class _Creeping(FrictionCoulomb):
    """The same with the joint's own ``solreffriction`` and ``solimpfriction``."""

    form = "MuJoCo has it by default, which creeps before it slips"
    forms = ()

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the joint's ``frictionloss`` and leave the rest."""
        spec.joint(at.name).frictionloss += theta[0]


FrictionCoulomb.forms = (_Creeping(),)
