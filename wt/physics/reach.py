"""Contacts that are not there yet: copies of models that see them from a distance, and where."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int


def reaching(model: mujoco.MjModel, gap: float, geom: int | None = None) -> mujoco.MjModel:
    """A copy of a model that lists contacts of geoms so far apart.

    Args:
        model: whose geoms may touch.
        gap: largest distance [m].
        geom: the one whose contacts are wanted; all if None.
    """
    copy = mujoco.MjModel.__copy__(model)
    if geom is None:
        copy.geom_gap[:] = gap
    else:
        copy.geom_gap[:] = 0.0
        copy.geom_gap[geom] = gap
    # bodies of several geoms are passed over by what was compiled: the gaps of before
    copy.body_margin[:] = gap
    return copy


def points_near(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int
) -> tuple[
    Float[np.ndarray, "contact 3"], Int[np.ndarray, " contact"], Float[np.ndarray, " contact"]
]:
    """Moving parts close to a geom, in the contacts that were found, C of them.

    Args:
        model: of :func:`reaching`.
        data: after a search for contacts.
        geom: the one that the others are close to.

    Returns:
        Points of the other surfaces, (C, 3) [m] in the world; their bodies, (C,); their distances
        from the geom, (C,) [m].
    """
    geoms, first = np.array(data.contact.geom), np.array(data.contact.geom[:, 0] == geom)
    bodies = model.geom_bodyid[np.where(first, geoms[:, 1], geoms[:, 0])]
    # two fixed geoms may touch only if the model pairs them by name
    touching = (geoms == geom).any(axis=1) & (model.body_weldid[bodies] != 0)
    distance = np.array(data.contact.dist[touching])
    # the normal points from the first geom to the second, whose surface is half a gap on
    half = 0.5 * np.where(first[touching], 1.0, -1.0) * distance
    points = data.contact.pos[touching] + half[:, None] * data.contact.frame[touching, :3]
    return points, bodies[touching], distance
