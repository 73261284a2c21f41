"""Something that stands in the way."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, register
from wt.physics.hits import face
from wt.physics.motion import Motion
from wt.physics.parts import add_geom
from wt.physics.replay_only import ReplayOnly
from wt.physics.units import HINGE, Units
from wt.types import Location

_HALF = (0.5, 0.5, 0.1)  # m: wide enough to be a table or a wall, and thick
_BIT = 1 << 20  # of contacts with it alone: robots' own files hardly use so many
_NAME = "obstacle"
_SLIPS, _HOLDS = 0.3, 1.0
"""Friction of faces that links slide along, and that hold them; MuJoCo's own is the second."""


@register
class ContactObstacle(ReplayOnly):
    """A box whose face is at a position, looks along a normal and has friction; nothing bounces.

    Forces say when something is touched, the shape of what touches says where
    (:mod:`wt.physics.hits`); only replays tell how well.
    """

    id = "contact.obstacle"
    kind = "world"
    parameters = (
        Parameter("position", "m", -20.0, 20.0, 1e-3, ("x", "y", "z")),
        Parameter("normal", "-", -1.0, 1.0, 2e-3, ("x", "y", "z"), inexact=0.08),
        Parameter("friction", "-", 0.02, 2.0, 0.01),
    )
    reference = "S. Haddadin, A. De Luca and A. Albu-Schäffer, Robot collisions, IEEE T-RO 33, 2017"

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """The face that the machine runs into, slippery and not."""
        touched = face(motion)
        if touched is None:
            return []
        return [np.array([*touched.position, *touched.normal, f]) for f in (_SLIPS, _HOLDS)]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add a box to the world that all moving bodies but the first can touch.

        Of a body, those geoms that can touch anything; all of them, if none can.
        """
        normal, turn = theta[3:6] / max(float(np.linalg.norm(theta[3:6])), 1e-9), np.zeros(4)
        mujoco.mju_quatZ2Vec(turn, normal)
        box = add_geom(
            spec, spec.worldbody, _NAME, type=mujoco.mjtGeom.mjGEOM_BOX, size=_HALF, quat=turn,
            pos=theta[:3] - _HALF[2] * normal, contype=_BIT, conaffinity=0, priority=1,
            condim=3, friction=[theta[6], 0.005, 0.0001], solref=[0.006, 1.0],
        )  # fmt: skip
        box.rgba = [0.8, 0.4, 0.1, 0.4]
        for body in spec.bodies[2:]:
            touching = [g for g in body.geoms if g.contype or g.conaffinity]
            for geom in touching or body.geoms:
                geom.conaffinity |= _BIT

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z, a, b, c, friction = theta
        return (
            f"Something stands in the way: its face is at {x:.3g}, {y:.3g}, {z:.3g} m and looks "
            f"along {a:.2g}, {b:.2g}, {c:.2g} (world x, y, z); its friction is {friction:.2g}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return "slow moves against it from several sides, with the outer links"
