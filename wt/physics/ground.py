"""The ground as it is: the plane of the feet that stand still.

A model has its floor level and where it was drawn; the robot may stand on a ramp, or what tracks
its base may have another idea of height. Points of the machine that could touch a floor and do not
move are, most of them, standing on it: the plane through most of these is the floor as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from wt.physics.reach import points_near, reaching
from wt.physics.scene import Scene

_REACH, _STANDING = 0.25, 0.05
"""Points so close to the model's floor [m], slower than this [m/s], may be standing."""
_SAMPLES, _ON_IT = 500, 0.006
"""Number of samples that are looked at; distance [m] from a plane within which points are on it."""
_LEAST, _MOST_OF_THEM = 40, 0.5
_CLEAR, _HIGH = 0.008, 0.006
"""A floor turned by less [rad], or higher by less [m], is the model's."""


@dataclass(frozen=True)
class Floor:
    """A plane of the model that is elsewhere in reality.

    Attributes:
        geom: id of the plane.
        angle: that it falls by [rad].
        direction: that it falls towards, from the world's x to its y [rad].
        height: how much higher it is at its own origin [m].
    """

    geom: int
    angle: float
    direction: float
    height: float

    def move(self, model: mujoco.MjModel) -> None:
        """Put the plane of a model there."""
        geom = self.geom
        model.geom_quat[geom] = turned(model.geom_quat[geom], self.angle, self.direction)
        model.geom_pos[geom, 2] += self.height
        model.geom_sameframe[geom] = 0  # else MuJoCo takes it to be where the world's frame is


def turned(
    quaternion: Float[np.ndarray, " 4"], angle: float, direction: float
) -> Float[np.ndarray, " 4"]:
    """A quaternion (w, x, y, z) after a turn that makes what was level fall towards a direction."""
    axis = np.array([-np.sin(direction), np.cos(direction), 0.0])
    turn, rotated = np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * axis)]), np.zeros(4)
    mujoco.mju_mulQuat(rotated, turn, np.array(quaternion, dtype=float))
    return rotated


def planes(model: mujoco.MjModel) -> list[int]:
    """The world's planes."""
    flat = model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)
    return [int(geom) for geom in np.flatnonzero(flat & (model.geom_bodyid == 0))]


def floors(
    scene: Scene, q: Float[np.ndarray, "sample dof"], v: Float[np.ndarray, "sample dof"]
) -> tuple[Floor, ...]:
    """The level planes of a model that are elsewhere, as the motion (T, nv) of a machine shows."""
    m, level_planes = scene.model, []
    for geom in planes(m) if scene.free else ():
        level = abs(abs(m.geom_quat[geom, 0]) - 1.0) < 1e-6
        if level and (floor := _floor(scene, geom, q, v)):
            level_planes.append(floor)
    return tuple(level_planes)


def _floor(
    scene: Scene, geom: int, q: Float[np.ndarray, "sample dof"], v: Float[np.ndarray, "sample dof"]
) -> Floor | None:
    points = _standing(scene, geom, q, v)
    if len(points) < _LEAST:
        return None
    level = np.array(scene.model.geom_pos[geom])
    slope, height, share = _plane(points - level)
    if share < _MOST_OF_THEM:
        return None
    angle = float(np.arctan(np.linalg.norm(slope)))
    if angle < _CLEAR:
        angle, slope = 0.0, np.zeros(2)
    if angle == 0.0 and abs(height) < _HIGH:
        return None
    return Floor(geom, angle, float(np.arctan2(-slope[1], -slope[0])), height)


def _plane(points: Float[np.ndarray, "point 3"]) -> tuple[Float[np.ndarray, " 2"], float, float]:
    """The plane through most points [m]: its slope along x and y, its height, the share on it."""
    known = np.column_stack([points[:, :2], np.ones(len(points))])
    # all but linear in the distance, so that a minority beside the plane does not turn it
    robust = least_squares(
        lambda plane: known @ plane - points[:, 2],
        [0.0, 0.0, np.median(points[:, 2])],
        jac=lambda _: known,
        loss="soft_l1",
        f_scale=0.1 * _ON_IT,
    )
    on_it = np.abs(robust.fun) < _ON_IT
    if on_it.sum() < 3:
        return np.zeros(2), 0.0, 0.0
    plane = np.linalg.lstsq(known[on_it], points[on_it, 2])[0]
    return plane[:2], float(plane[2]), float(on_it.mean())


def _standing(
    scene: Scene, geom: int, q: Float[np.ndarray, "sample dof"], v: Float[np.ndarray, "sample dof"]
) -> Float[np.ndarray, "point 3"]:
    """Points of the machine near a plane that do not move, (n, 3) [m]."""
    m = reaching(scene.model, _REACH, geom)
    d, jacobian, touched = mujoco.MjData(m), np.zeros((3, m.nv)), [np.zeros((0, 3))]
    for k in range(0, len(q), max(1, len(q) // _SAMPLES)):
        d.qpos[:] = q[k]
        mujoco.mj_fwdPosition(m, d)
        points, bodies, _ = points_near(m, d, geom)
        for point, body in zip(points, bodies, strict=True):
            mujoco.mj_jac(m, d, jacobian, None, point, body)
            if np.linalg.norm(jacobian @ v[k]) < _STANDING:
                touched.append(point[None])
    return np.concatenate(touched)
