"""Bodies whose inertia is written explicitly, so that effects can change it."""

from __future__ import annotations

import mujoco
import numpy as np

Array = np.ndarray


def explicit(spec: mujoco.MjSpec, body: str) -> mujoco.MjsBody:
    """Write a body's inertia explicitly, in place; its geoms then only collide and show.

    Args:
        spec: the model.
        body: the body's name.

    Returns:
        The body, with ``mass``, ``ipos``, ``iquat`` and ``inertia`` as they were compiled.
    """
    element = spec.body(body)
    if not element.explicitinertial:
        compiled = spec.copy().compile().body(body)
        element.mass = float(compiled.mass[0])
        element.ipos, element.iquat = compiled.ipos, compiled.iquat
        element.inertia = compiled.inertia
        element.explicitinertial = True
    if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    return element


def difference(model: mujoco.MjModel, body: str, **changes: Array | float) -> mujoco.MjModel:
    """A copy of a compiled model with another mass, centre of mass or inertia of one body.

    Args:
        model: the model.
        body: the body's name.
        changes: factors ``mass`` and ``inertia``, and the shift ``ipos`` [m].
    """
    edited = model.__copy__()
    i = edited.body(body).id
    edited.body_mass[i] *= changes.get("mass", 1.0)
    edited.body_inertia[i] *= changes.get("inertia", 1.0)
    edited.body_ipos[i] += changes.get("ipos", 0.0)
    # derived constants (subtree masses, inverse weights) follow
    mujoco.mj_setConst(edited, mujoco.MjData(edited))
    return edited
