"""Dry friction that is larger at standstill than in motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._bristle import WithDryFriction, brake
from wt.physics.effects._tools import (
    compiled,
    effective_inertia,
    passive,
    physics_step,
)
from wt.physics.hooks import Beyond, Intervals, Nested
from wt.physics.live import Law, Values
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units
from wt.types import Location

_STIFFNESS, _DAMPING = 0.1, 0.5
"""Frequency · time step and damping ratio of the bristle: a stiffer one, which MuJoCo damps a step
late, brakes too much; against a machine that has it, .1 errs by a seventh of what .4 does."""


@Law
def _sticking(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    coulomb, static, velocity = theta[0], theta[1], theta[2]
    slow = math.exp(-((v[dof] / velocity) ** 2))
    return brake(coulomb + (max(static, coulomb) - coulomb) * slow, v[dof], h, own)


@register
class FrictionStribeck(Nested, WithDryFriction):
    """τ = −sign(v) · (coulomb + (static − coulomb) · exp(−(v / velocity)²))."""

    id = "joint.friction_stribeck"
    kind = "joint"
    law = _sticking
    parameters = (
        Parameter("coulomb", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("static", "N·m", 0.0, 1e8, 1e-3, neutral=0.0, inexact=0.03),
        Parameter("velocity", "rad/s", 1e-3, 10.0, 1e-3, inexact=0.03),
    )
    reference = (
        "C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, A new model for control of "
        "systems with friction, IEEE Transactions on Automatic Control 40(3), 1995"
    )
    unites = ("joint.friction_coulomb", "joint.friction_stribeck")
    dry = (0, 1)
    signed = (1, 1)
    looks_like = ("dry friction", "friction by speed")
    plotted_over = "velocity"

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Velocities over which friction falls, up to a third of the joint's fastest."""
        fastest = float(np.abs(motion.v[:, motion.scene.dof(at.name)]).max())
        return [(v,) for v in (0.02, 0.05, 0.1, 0.2, 0.4, 0.8) if v < fastest / 3.0]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−sign(v) and −sign(v)·exp(−(v/velocity)²)."""
        dof = motion.scene.dof(at.name)
        v = motion.v[:, dof]
        return motion.on(dof, -np.sign(v), -np.sign(v) * np.exp(-((v / shape[0]) ** 2)))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Friction in motion, at standstill, and the velocity between them."""
        return np.array([coefficients[0], coefficients.sum(), shape[0]])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add a passive motor with LuGre friction.

        Its bristle is as stiff as the joint's inertia and the time step allow, so that the joint
        sticks within a small fraction of a degree.
        """
        coulomb, static = float(theta[0]), float(max(theta[1], theta[0]))
        if static <= 0.0:
            return
        inertia = effective_inertia(compiled(spec), at.name)
        frequency = _STIFFNESS / physics_step(spec)
        stiffness, damping = inertia * frequency**2, 2.0 * _DAMPING * inertia * frequency
        lugre = [stiffness, damping, max(coulomb, 1e-6 * static), static, float(theta[2])]
        passive(spec, f"{at.name}_friction", at.name, lugre=lugre)

    def beyond(
        self, motion: Motion, at: Location, law: str, theta: Float[np.ndarray, " smaller"]
    ) -> Sequence[Beyond]:
        """Coulomb's friction with half as much more at rest: the screen leaves slow rows out."""
        if law != "joint.friction_coulomb":
            return []
        velocities = self.shapes(motion, at)
        return [((v,), np.array([theta[0], 1.5 * theta[0], v])) for (v,) in velocities]

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Without a rise of a tenth towards rest it is plain dry friction."""
        return bool(theta[1] > 1.1 * theta[0])

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Coulomb's, where friction at standstill is not clearly another."""
        apart = np.min(intervals["static"][0]) > np.max(intervals["coulomb"][1])
        return None if apart else ("joint.friction_coulomb", theta[:1])

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} sticks with {theta[1]:.3g} {units.force} and slides with "
            f"{theta[0]:.3g} {units.force} of dry friction; the fall happens within "
            f"{theta[2]:.2g} {units.speed}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow reversals of {at.name} below 0.05 {units.speed}, and starts from rest"
