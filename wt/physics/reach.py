"""Contacts that are not there yet: copies of models that see them from a distance."""

from __future__ import annotations

import mujoco


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
