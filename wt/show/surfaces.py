"""Geoms as closed surfaces of flat faces, seen from outside counterclockwise."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

Faces = Float[np.ndarray, "face corner=4 xyz=3"]
"""Faces of four corners; a triangle repeats its last one."""

MOST_FACES = 400
"""A mesh with more is replaced by the hull of its outermost points."""


def surface(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Faces:
    """A geom's faces in the world [m]."""
    size = model.geom_size[geom]
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            local = _turned([(size[0] * np.cos(a), size[0] * np.sin(a)) for a in _arc()])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            local = _turned([(np.cos(a), np.sin(a)) for a in _arc()]) * size
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            profile = [
                (size[0] * np.cos(a), size[0] * np.sin(a) + np.copysign(size[1], a)) for a in _arc()
            ]
            local = _turned(profile)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            r, h = size[0], size[1]
            local = _turned([(0.0, -h), (r, -h), (r, h), (0.0, h)])
        case mujoco.mjtGeom.mjGEOM_MESH:
            local = _mesh(model, int(model.geom_dataid[geom]))
        case _:  # a box, or another shape's bounding box
            center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            local = center + half * _cube()
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def _arc() -> Float[np.ndarray, " latitude"]:
    """Latitudes from pole to pole, an even number so that none is the equator [rad]."""
    return np.linspace(-np.pi / 2, np.pi / 2, 10)


def _turned(profile: Sequence[tuple[float, float]], sides: int = 20) -> Faces:
    """The surface of revolution of a profile of (radius, height)."""
    angles = np.linspace(0.0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [np.column_stack([r * ring, np.full(len(ring), h)]) for r, h in profile]
    faces = [
        np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
        for low, high in itertools.pairwise(rings)
    ]
    return np.concatenate(faces)


def _cube() -> Faces:
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = square if side > 0 else square[::-1]
            faces.append(np.insert(corners if axis != 1 else corners[::-1], axis, side, axis=1))
    return np.stack(faces)


def _mesh(model: mujoco.MjModel, mesh: int) -> Faces:
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count].astype(float)
    start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = model.mesh_face[start : start + count]
    if count > MOST_FACES:
        directions = _turned([(np.cos(a), np.sin(a)) for a in _arc()]).reshape(-1, 3)
        vertices = vertices[np.unique((vertices @ directions.T).argmax(axis=0))]
        hull = ConvexHull(vertices, qhull_options="QJ")
        outward = np.cross(
            vertices[hull.simplices[:, 1]] - vertices[hull.simplices[:, 0]],
            vertices[hull.simplices[:, 2]] - vertices[hull.simplices[:, 0]],
        )
        flipped = (outward * hull.equations[:, :3]).sum(axis=1) < 0
        faces = np.where(flipped[:, None], hull.simplices[:, ::-1], hull.simplices)
    return np.asarray(vertices[np.column_stack([faces, faces[:, 2]])])
