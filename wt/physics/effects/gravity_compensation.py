"""A robot whose drives or springs carry its own weight, which the model does not know."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.physics.parts import compiled
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_LEAST = 0.1
"""Smallest share: what is less is an error of some mass."""


@register
class GravityCompensation(Effect):
    """τ = −share · Jᵀ m g, of one body or, at ``all``, of every one that moves."""

    id = "world.gravity_compensation"
    kind = "body"
    parameters = (Parameter("share", "-", 0.0, 2.0, 1e-3, neutral=0.0),)
    reference = "MuJoCo XML reference, body/gravcomp"
    signed = (1,)

    def places(self, scene: Scene) -> Sequence[Location]:
        """The whole machine, if it stands on something: one body's is a force upwards on it."""
        return [] if scene.free or not scene.moving else [Location("body", "all")]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Linear, if there is gravity."""
        return [()] if np.any(motion.scene.model.opt.gravity) else []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force that carries all of the weight."""
        spec = motion.scene.spec()
        self.patch(spec, at, np.ones(1))
        return -motion.change(spec.compile())[:, :, None]

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The share."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the bodies' ``gravcomp``."""
        if theta[0] == 0.0:
            return
        if at.name != "all":
            spec.body(at.name).gravcomp += theta[0]
            return
        model = compiled(spec)
        for i, body in enumerate(spec.bodies):
            if model.body_weldid[i] != 0:  # not fixed to the world
                body.gravcomp += theta[0]

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse some per cent, which any mass is off by."""
        return bool(theta[0] > _LEAST)

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        whose = "all bodies" if at.name == "all" else f"body {at.name}"
        share = f"{100 * theta[0]:.3g} %"
        return f"{share} of the weight of {whose} is carried, which the model leaves out."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return "holding still at many poses, with the arm out and folded, and fast motions"
