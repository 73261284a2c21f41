"""Forces of drives in laws that act at every step, which take them from a place's own figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from wt.physics.live import Figures, Values, in_laws
from wt.physics.scene import Drive, Scene
from wt.types import Location

_DRIVE = 10  # figures of a drive


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
