"""A robot that does not stand upright."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import TURN, bearing
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class WorldGravity(Effect):
    """Gravity turned by an angle towards a horizontal direction (0 is the world's x, π/2 its y)."""

    id = "world.gravity"
    kind = "world"
    parameters = (
        Parameter("angle", "rad", 0.0, 1.5, 1e-4, neutral=0.0),
        Parameter("direction", "rad", *TURN, 1e-3, comes_round=True),
    )
    reference = "MuJoCo XML reference, option/gravity"
    signed = (0, 0)
    looks_like = ("pull",)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Linear, if there is gravity."""
        return [()] if np.any(motion.scene.model.opt.gravity) else []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force of as much gravity as there is along the world's x and y."""
        columns = []
        for direction in (0.0, 0.5 * np.pi):
            model = copy.copy(motion.scene.model)
            _, side = _axes(model.opt.gravity, direction)
            model.opt.gravity += np.linalg.norm(model.opt.gravity) * side
            columns.append(-motion.change(model))
        return np.stack(columns, axis=2)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Angle and direction."""
        x, y = coefficients
        return np.array([np.arcsin(min(np.hypot(x, y), 1.0)), np.arctan2(y, x)])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Turn ``option gravity``, its size kept."""
        gravity = np.array(spec.option.gravity)
        down, side = _axes(gravity, float(theta[1]))
        turned = np.cos(theta[0]) * down + np.sin(theta[0]) * side
        spec.option.gravity = np.linalg.norm(gravity) * turned

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Gravity is tilted by {np.degrees(theta[0]):.3g}° towards {bearing(theta[1])} (from "
            "the world's x to its y): the robot does not stand as the model says."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return "holding still at many poses, the whole arm turned about the vertical in between"


def _axes(
    gravity: Float[np.ndarray, " 3"], direction: float
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """(direction of gravity, unit vector across it towards a horizontal direction)."""
    size = np.linalg.norm(gravity)
    down = gravity / size if size > 0.0 else np.array([0.0, 0.0, -1.0])
    side = np.array([np.cos(direction), np.sin(direction), 0.0])
    side = side - (side @ down) * down
    length = np.linalg.norm(side)
    return down, side / length if length > 1e-9 else np.zeros(3)
