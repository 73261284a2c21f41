"""An MJCF without what no replay can tell, which compiles in a fraction of the time.

A search compiles a model for every set of parameters that it tries. Textures and meshes that
nothing touches are most of that work, and what a patch would have to compile for, weights and
servos that the compiler derives, is written out once instead.
"""

from __future__ import annotations

import functools

import mujoco
import numpy as np

from wt.physics.parts import settle, write_weights

_DOT = 1e-3  # m, radius of what stands where a mesh was


def slim(spec: mujoco.MjSpec) -> None:
    """Take out of an MJCF what moves nothing, in place; every element keeps its name and number."""
    settle(spec)
    write_weights(spec)
    for element in (*spec.geoms, *spec.sites, *spec.tendons):
        element.material = ""
    for geom in spec.geoms:
        touched = bool(geom.contype or geom.conaffinity) or _paired(spec, geom.name)
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not touched and not geom.fluid_ellipsoid:
            # a mesh moves its geom's frame to its own centre: nothing asks where this one is
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, ""
            geom.size = [_DOT, 0.0, 0.0]
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
    for part in (*spec.materials, *spec.textures):
        spec.delete(part)


def _paired(spec: mujoco.MjSpec, geom: str) -> bool:
    return any(geom in (pair.geomname1, pair.geomname2) for pair in spec.pairs)


def rest_idle(model: mujoco.MjModel) -> None:
    """Switch off, in place, the stages of a physics step that have nothing to do in it.

    Looking for contacts among geoms that never collide is a fifth of a small arm's step, and for
    islands among the constraints of joints an eighth. What steps say stays the same, but for what
    rounding does where constraints are solved together instead of island by island.
    """
    if may_touch(model):
        return
    off = mujoco.mjtDisableBit
    held = (model.neq, model.jnt_limited, model.tendon_limited)
    rubbing = (model.dof_frictionloss, model.tendon_frictionloss)
    constrained = any(np.any(some) for some in (*held, *rubbing))
    idle = off.mjDSBL_ISLAND if constrained else off.mjDSBL_CONSTRAINT
    model.opt.disableflags |= off.mjDSBL_CONTACT | idle


def may_touch(model: mujoco.MjModel) -> bool:
    """Whether two geoms of parts that move against each other may collide, wherever they are."""
    if model.npair or model.nflex:
        return True
    part = model.body_weldid[model.geom_bodyid]
    return _may_touch(
        part.tobytes(), model.geom_contype.tobytes(), model.geom_conaffinity.tobytes()
    )


@functools.lru_cache(maxsize=256)  # of the models of a search, nearly all have the same geoms
def _may_touch(of_parts: bytes, types: bytes, affinities: bytes) -> bool:
    part, contype, conaffinity = (np.frombuffer(x, np.int32) for x in (of_parts, types, affinities))
    bits = (contype[:, None] & conaffinity) != 0
    return bool(((bits | bits.T) & (part[:, None] != part)).any())
