"""What laws that act at every step have in common: forces of drives, and bristles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Int

from wt.physics.effects._tools import effective_inertia
from wt.physics.hooks import OnSteps
from wt.physics.live import Figures, Law, Live, Values, in_laws
from wt.physics.scene import Drive, Scene
from wt.physics.script import Helper, Script
from wt.types import Location

_FREQUENCY, _DAMPING = 0.4, 0.5  # of a bristle: frequency · time step, damping ratio
_DRIVE = 10  # figures of a drive
BRISTLE = 2
"""Figures that a bristle has at the beginning of what is a place's own."""


@in_laws
def between(x: Figures, low: Figures, high: Figures) -> Figures:
    """``numpy.clip``, of one figure too."""
    clipped: Figures = np.minimum(np.maximum(x, low), high)
    return clipped


def figures(drive: Drive) -> list[float]:
    """A drive as :func:`force_of` reads it."""
    law = (drive.gear, drive.gain, *drive.bias)
    return [float(drive.index), *law, *drive.commands, *drive.forces]


@in_laws
def force_of(own: Values, first: int, q: float, v: float, u: Values) -> float:
    """Force of a drive on its joint, as of :meth:`Drive.force`.

    Args:
        own: what is a place's own.
        first: where the drive's figures begin in it.
        q: position of its joint.
        v: velocity of it.
        u: all commands.
    """
    gear, gain, constant = own[first + 1], own[first + 2], own[first + 3]
    spring = own[first + 4] * gear * q + own[first + 5] * gear * v
    command = between(u[int(own[first])], own[first + 6], own[first + 7])
    force: float = between(gain * command + constant + spring, own[first + 8], own[first + 9])
    return gear * force


def driven(scene: Scene, at: Sequence[Location]) -> Float[np.ndarray, "place figure"]:
    """Figures of the drive at each place."""
    return np.array([figures(scene.drive(place.name)) for place in at])


def dofs_of(scene: Scene, at: Sequence[Location]) -> Int[np.ndarray, " place"]:
    """Degree of freedom of the drive at each place."""
    return np.array([scene.drive(place.name).dof for place in at])


def all_drives(scene: Scene, dofs: Int[np.ndarray, " place"]) -> Float[np.ndarray, "place figure"]:
    """Figures of all drives on the joint of each place, behind their number."""
    of = [[figures(d) for d in scene.drives if d.dof == dof] for dof in dofs.tolist()]
    table = np.zeros((len(of), 1 + _DRIVE * max(map(len, of), default=0)))
    for row, own in zip(table, of, strict=True):
        row[0] = len(own)
        row[1 : 1 + _DRIVE * len(own)] = np.ravel(own)
    return table


@in_laws
def force_of_all(own: Values, first: int, q: float, v: float, u: Values) -> float:
    """Force of all drives on a joint, whose figures (:func:`all_drives`) begin at ``first``."""
    force = 0.0
    for i in range(int(own[first])):
        force += force_of(own, first + 1 + i * _DRIVE, q, v, u)
    return force


@in_laws
def brake(level: float, v: float, h: float, own: Values) -> float:
    """Force of a bristle on a joint: a spring with a damper that slips at a friction force.

    It sticks without chatter, as stiff as steps of such a length allow.

    Args:
        level: friction at which it slips [N·m or N].
        v: velocity of the joint.
        h: length of the step [s].
        own: how far it is bent, which is brought up to date, and the inertia that it brakes.
    """
    frequency = _FREQUENCY / h
    stiffness, damping = own[1] * frequency**2, 2.0 * _DAMPING * own[1] * frequency
    # the bristle bends with the joint and slips where it would carry more than friction
    bend = level / stiffness
    own[0] = between(own[0] + h * v, -bend, bend)
    return -between(stiffness * own[0] + damping * v, -level, level)


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
    def slipping(at: Location, level: Sequence[str], helper: Helper) -> Script:
        """The same without this package.

        Args:
            at: the joint.
            level: lines that say at which friction the bristle slips, in ``level``.
            helper: what they call.
        """
        force = (
            *level,
            f'friction, dof = self._bristle("{at.name}", qvel, level, h)',
            "f[:, dof] += friction",
        )
        return Script(force=force, helpers=(helper, "bristle"))
