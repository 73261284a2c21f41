"""Torque that varies with the rotor's position: cogging, or teeth of a gear."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import TURN, passive
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_FEWEST = 3.0  # cycles a turn
_WHOLE = 1.0  # cycles that the motion covers: of less than one, nothing can come again


@register
class ActuatorRipple(Effect):
    """τ = amplitude · sin(cycles · q + phase)."""

    id = "actuator.ripple"
    kind = "actuator"
    parameters = (
        Parameter("amplitude", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("cycles", "1/rev", 1.0, 500.0, 1e-3),
        Parameter("phase", "rad", *TURN, 1e-3, of_joint=False, comes_round=True),
    )
    reference = "MuJoCo XML reference, actuator/dcmotor/cogging"
    signed = (0, 0)
    comes_again = True

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives of hinges."""
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        return [
            Location("actuator", d.name)
            for d in scene.drives
            if scene.model.joint(d.joint).type[0] == hinge
        ]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Up to 60 cycles a turn, as far as they come again."""
        covered = _turns(motion, at)
        return [(float(n),) for n in range(3, 61) if n * covered >= _WHOLE]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """cos(cycles·q) and sin(cycles·q)."""
        dof = motion.scene.drive(at.name).dof
        angle = shape[0] * motion.q[:, dof]
        return motion.on(dof, np.cos(angle), np.sin(angle))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Amplitude, cycles and phase."""
        # a·sin(x + φ) = a·sin φ · cos x + a·cos φ · sin x
        c, s = coefficients
        return np.array([np.hypot(c, s), shape[0], np.arctan2(c, s)])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add a passive motor with ``cogging`` to the joint."""
        amplitude, cycles, phase = (float(x) for x in theta)
        if amplitude > 0.0:
            joint = spec.actuator(at.name).target
            passive(spec, f"{at.name}_ripple", joint, cogging=[amplitude, cycles, phase])

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse one or two waves a turn, a weight, and one bend in all of a motion, a spring."""
        return bool(theta[1] >= _FEWEST and theta[1] * _turns(motion, at) >= _WHOLE)

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        often = f"{theta[1]:.4g} times a turn"
        if units.slide:
            often = f"{theta[1] / (2.0 * np.pi):.4g} times a metre"
        return (
            f"The force of actuator {at.name} ripples by ±{theta[0]:.3g} {units.force}, {often} of "
            "the joint."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow moves of the joint of {at.name} over its whole range, both ways"


def _turns(motion: Motion, at: Location) -> float:
    """Part of a turn that a drive's joint covers."""
    return float(np.ptp(motion.q[:, motion.scene.drive(at.name).dof]) / (2.0 * np.pi))
