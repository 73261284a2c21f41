"""A spring over two joints, such as a belt, a bundle of cables or a parallelogram's spring."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import neighbours, no_spring
from wt.physics.motion import Motion
from wt.physics.parts import add_tendon
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_RATIOS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0)
_EITHER = 0.1
"""Smallest ratio, and its inverse the largest: beyond, it is a spring at one of the joints."""


@register
class PairSpring(Effect):
    """τ = −stiffness · (q_a + ratio · q_b − reference) on a, and ratio times that on b."""

    id = "pair.spring"
    kind = "pair"
    parameters = (
        Parameter("stiffness", "N·m/rad", 0.0, 1e8, 1e-2, neutral=0.0),
        Parameter("ratio", "-", -10.0, 10.0, 1e-3),
        Parameter("reference", "rad", -70.0, 70.0, 1e-3),
    )
    reference = "MuJoCo XML reference, tendon/fixed"
    signed = (1, 0)
    odds_against = 4.0

    def places(self, scene: Scene) -> Sequence[Location]:
        """Every joint with the next one towards the base."""
        return [Location("pair", f"{a}+{b}") for a, b in neighbours(scene)]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Ratios of either sign."""
        return [(sign * ratio,) for ratio in _RATIOS for sign in (1.0, -1.0)]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force per stiffness towards zero, and per stiffness times reference."""
        a, b = (motion.scene.dof(name) for name in at.name.split("+"))
        stretch = motion.q[:, a] + shape[0] * motion.q[:, b]
        force = np.stack([-stretch, np.ones(len(motion))], axis=1)
        columns = np.zeros((*motion.q.shape, 2))
        columns[:, a], columns[:, b] = force, shape[0] * force
        return columns

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Stiffness, ratio, reference."""
        stiffness, pull = coefficients
        return np.array([stiffness, shape[0], pull / max(float(stiffness), 1e-9)])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """A fixed tendon over both joints with a spring."""
        if theta[0] <= 0.0:
            return
        a, b = at.name.split("+")
        tendon = add_tendon(
            spec,
            f"{a}_{b}_spring",
            stiffness=[theta[0], 0.0, 0.0],
            springlength=[theta[2], theta[2]],
        )
        tendon.wrap_joint(a, 1.0)
        tendon.wrap_joint(b, float(theta[1]))

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse a spring at one joint."""
        return bool(_EITHER < abs(theta[1]) < 1.0 / _EITHER)

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """Its rest is so far away that it would be a constant force."""
        a, b = (motion.scene.dof(name) for name in at.name.split("+"))
        return no_spring(motion.q[:, a] + theta[1] * motion.q[:, b], float(theta[2]))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        a, b = at.name.split("+")
        sign = "−" if theta[1] < 0.0 else "+"
        sum_ = f"{a} {sign} {abs(theta[1]):.3g} · {b}"
        return (
            f"A spring of {theta[0]:.3g} {units.stiffness} pulls {sum_} towards {theta[2]:.3g} "
            f"{units.position}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        a, b = at.name.split("+")
        return f"slow sweeps of {a} with {b} held at several angles, and of {b} with {a} held"
