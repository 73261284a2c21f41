"""Friction by an elastic bristle, which laws that act at every step have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Int

from wt.physics.driving import between
from wt.physics.effects._tools import effective_inertia
from wt.physics.hooks import OnSteps, Parts, Uniting
from wt.physics.live import Law, Live, Values, in_laws
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Helper, Script
from wt.types import Location

_FREQUENCY, _DAMPING = 0.4, 0.5  # frequency · time step, damping ratio
BRISTLE = 2
"""Figures that a bristle has at the beginning of what is a place's own."""


@in_laws
def brake(level: float, v: float, h: float, own: Values) -> float:
    """Force of a bristle that slips at the same friction both ways, see :func:`slip`."""
    return slip(level, level, v, h, own)


@in_laws
def slip(ahead: float, back: float, v: float, h: float, own: Values) -> float:
    """Force of a bristle on a joint: a spring with a damper that slips at a friction force.

    It sticks without chatter, as stiff as steps of such a length allow.

    Args:
        ahead: friction at which it slips forward [N·m or N].
        back: the same backward.
        v: velocity of the joint.
        h: length of the step [s].
        own: how far it is bent, which is brought up to date, and the inertia that it brakes.
    """
    frequency = _FREQUENCY / h
    stiffness, damping = own[1] * frequency**2, 2.0 * _DAMPING * own[1] * frequency
    # the bristle bends with the joint and slips where it would carry more than friction
    own[0] = between(own[0] + h * v, -back / stiffness, ahead / stiffness)
    return -between(stiffness * own[0] + damping * v, -back, ahead)


class BristleFriction(OnSteps):
    """Base of friction laws that brake a joint by an elastic bristle.

    Attributes:
        law: says how large the friction is, and brakes by that.
    """

    law: ClassVar[Law]

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Friction by an elastic bristle that slips."""
        dofs = np.array([scene.dof(place.name) for place in at])
        inertia = [effective_inertia(scene.model, place.name) for place in at]
        bristles = np.stack([np.zeros(len(at)), inertia], axis=1)
        return Live(self.law, dofs, theta, np.hstack([bristles, self.needs(scene, dofs)]))

    def needs(
        self, scene: Scene, dofs: Int[np.ndarray, " place"]
    ) -> Float[np.ndarray, "place figure"]:
        """What else its law needs to know of each joint."""
        return np.empty((len(dofs), 0))

    @staticmethod
    def slipping(at: Location, level: Sequence[str], helper: Helper, back: str = "level") -> Script:
        """The same without this package.

        Args:
            at: the joint.
            level: lines that say at which friction the bristle slips, in ``level``.
            helper: what they call.
            back: name that they give the friction at which it slips backward.
        """
        force = (
            *level,
            f'friction, dof = self._bristle("{at.name}", qvel, -{back}, level, h)',
            "f[:, dof] += friction",
        )
        return Script(force=force, helpers=(helper, "bristle"))


class WithDryFriction(Uniting, BristleFriction):
    """Base of laws that have dry friction in them, so that none has to stand beside them.

    Attributes:
        dry: the parameters that dry friction adds to.
    """

    dry: ClassVar[tuple[int, ...]] = (0,)

    def union(
        self, motion: Motion, at: Location, parts: Parts
    ) -> Float[np.ndarray, " parameter"] | None:
        """This law with the dry friction beside it, unless that takes away more than there is."""
        if (self.id, at) not in parts:
            return None
        theta = parts[self.id, at].copy()
        theta[list(self.dry)] += parts["joint.friction_coulomb", at][0]
        return theta if theta[0] >= 0.0 else None
