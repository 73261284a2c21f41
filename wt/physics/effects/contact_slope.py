"""A floor that is not level, or not as high as the model has it."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, register
from wt.physics.effects._tools import TURN, bearing
from wt.physics.ground import planes, turned
from wt.physics.motion import Motion
from wt.physics.parts import compiled
from wt.physics.replay_only import ReplayOnly
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class ContactSlope(ReplayOnly):
    """A plane that falls by an angle towards a direction (0 is the world's x, π/2 its y).

    No force tells it, but feet that stand still do (:mod:`wt.physics.ground`).
    """

    id = "contact.slope"
    kind = "geom"
    parameters = (
        Parameter("angle", "rad", 0.0, 0.7, 1e-4, neutral=0.0),
        Parameter("direction", "rad", *TURN, 1e-3, comes_round=True),
        Parameter("height", "m", -1.0, 1.0, 1e-4, neutral=0.0),
    )
    reference = "M. A. Fischler and R. C. Bolles, Random sample consensus, 1981"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Named planes of the world."""
        names = [scene.model.geom(geom).name for geom in planes(scene.model)]
        return [Location("geom", name) for name in names if name]

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """The plane on which the feet stand."""
        geom = motion.scene.model.geom(at.name).id
        return [
            np.array([floor.angle, floor.direction, floor.height])
            for floor in motion.floors
            if floor.geom == geom
        ]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Turn and lift the plane."""
        plane, model = spec.geom(at.name), compiled(spec)
        plane.quat = turned(model.geom(at.name).quat, float(theta[0]), float(theta[1]))
        plane.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        plane.pos = [*plane.pos[:2], plane.pos[2] + theta[2]]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"The ground {at.name} falls by {np.degrees(theta[0]):.3g}° towards "
            f"{bearing(theta[1])} (from the world's x to its y), {1e3 * theta[2]:.3g} mm higher at "
            "its origin than the model says."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"standing still at several places of {at.name}, facing several ways"
