"""Forces of drives in laws that act at every step, which take them from a place's own figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from wt.physics.live import Figures, Values, in_laws
from wt.physics.scene import Drive, Scene
from wt.types import Location

_DRIVE = 11  # figures of a drive


@in_laws
def between(x: Figures, low: Figures, high: Figures) -> Figures:
    """``numpy.clip``, of one figure too."""
    clipped: Figures = np.minimum(np.maximum(x, low), high)
    return clipped


def figures(scene: Scene, drive: Drive) -> list[float]:
    """A drive as :func:`force_of` reads it."""
    law = (drive.gear, drive.gain, *drive.bias)
    side = float(motor_side(scene, drive.dof))
    return [float(drive.index), *law, *drive.commands, *drive.forces, side]


def motor_side(scene: Scene, dof: int) -> int:
    """Index of the side of a joint that its drives are on, in what laws see and act on."""
    return int(scene.model.nv) + dof


@in_laws
def force_of(own: Values, first: int, q: Values, v: Values, u: Values) -> float:
    """Force of a drive on its side of the joint, as of :meth:`Drive.force`.

    Args:
        own: what is a place's own.
        first: where the drive's figures begin in it.
        q: all positions.
        v: all velocities.
        u: all commands.
    """
    gear, gain, constant = own[first + 1], own[first + 2], own[first + 3]
    side = int(own[first + 10])
    spring = own[first + 4] * gear * q[side] + own[first + 5] * gear * v[side]
    command = between(u[int(own[first])], own[first + 6], own[first + 7])
    force: float = between(gain * command + constant + spring, own[first + 8], own[first + 9])
    return gear * force


def driven(scene: Scene, at: Sequence[Location]) -> Float[np.ndarray, "place figure"]:
    """Figures of the drive at each place."""
    return np.array([figures(scene, scene.drive(place.name)) for place in at])


def sides_of(scene: Scene, at: Sequence[Location]) -> Int[np.ndarray, " place"]:
    """The side of the joint that the drive at each place is on."""
    return np.array([motor_side(scene, scene.drive(place.name).dof) for place in at])


def all_drives(scene: Scene, dofs: Int[np.ndarray, " place"]) -> Float[np.ndarray, "place figure"]:
    """Figures of all drives on the joint of each place, behind their number."""
    of = [[figures(scene, d) for d in scene.drives if d.dof == dof] for dof in dofs.tolist()]
    table = np.zeros((len(of), 1 + _DRIVE * max(map(len, of), default=0)))
    for row, own in zip(table, of, strict=True):
        row[0] = len(own)
        row[1 : 1 + _DRIVE * len(own)] = np.ravel(own)
    return table


@in_laws
def force_of_all(own: Values, first: int, q: Values, v: Values, u: Values) -> float:
    """Force of all drives on a joint, whose figures (:func:`all_drives`) begin at ``first``."""
    force = 0.0
    for i in range(int(own[first])):
        force += force_of(own, first + 1 + i * _DRIVE, q, v, u)
    return force
