"""Inertia of joints, and what a motion demands by a body's mass, centre of mass and inertia.

Inverse dynamics are linear in the ten inertial parameters of each body (C. H. An, C. G. Atkeson
and J. M. Hollerbach, Estimation of inertial parameters of rigid body links, 1985): mass m, first
moments m·c, and the moments of inertia about the body frame's origin, all in the body's frame.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.motion import Motion
from wt.physics.scene import Scene

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # of the moments of inertia


def parameters(
    mass: float, centre: Float[np.ndarray, " 3"], inertia: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, " 10"]:
    """The ten inertial parameters, (10,).

    Args:
        mass: [kg].
        centre: centre of mass in the body's frame, (3,) [m].
        inertia: about the centre of mass, in the body's frame, (3, 3) [kg·m²].
    """
    about_origin = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    moments = [about_origin[i, j] for i, j in _PAIRS]
    return np.array([mass, *(mass * centre), *moments])


def own(scene: Scene, body: str) -> tuple[float, Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """Mass, centre of mass and inertia about it of a body as the model has them."""
    b = scene.model.body(body)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, b.iquat)
    axes = rotation.reshape(3, 3)
    return float(b.mass[0]), np.array(b.ipos), axes @ np.diag(b.inertia) @ axes.T


def of_joints(
    model: mujoco.MjModel, data: mujoco.MjData, q: Float[np.ndarray, " dof"]
) -> Float[np.ndarray, "dof dof"]:
    """Inertia that a machine of hinges and slides has in a place, where it stands afterwards.

    Args:
        model: the machine.
        data: its state; what follows from velocities is left as it was.
        q: the place [rad or m].
    """
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_makeM(model, data)
    found = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, found)
    return found


@lru_cache(maxsize=64)
def demand(motion: Motion, body: str) -> Float[np.ndarray, "sample dof 10"]:
    """Generalised force demanded per unit of each inertial parameter, (T, nv, 10)."""
    spin, turning, lifting, *_ = kinematics(motion)[body]
    axes = np.eye(3)
    moved = [np.cross(turning, e) + np.cross(spin, np.cross(spin, e)) for e in axes]
    forces = [lifting, *moved, *[np.zeros_like(spin)] * 6]
    torques = [np.zeros_like(spin), *[np.cross(e, lifting) for e in axes]]
    for i, j in _PAIRS:
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        torques.append(turning @ unit + np.cross(spin, spin @ unit))
    wrenches = np.concatenate([np.stack(x, axis=2) for x in (forces, torques)], axis=1)
    return np.asarray(reach(motion, body) @ wrenches)


@lru_cache(maxsize=8)
def reach(motion: Motion, body: str) -> Float[np.ndarray, "sample dof 6"]:
    """Generalised force per unit of each force and torque at a body's origin, (T, nv, 6)."""
    moved = kinematics(motion)[body]
    return np.ascontiguousarray(np.concatenate([moved.slide, moved.turn], axis=1).swapaxes(1, 2))


class Moved(NamedTuple):
    """Motion of a body, in its own frame.

    Attributes:
        spin: its angular velocity, (T, 3) [rad/s].
        turning: its angular acceleration, (T, 3) [rad/s²].
        lifting: linear acceleration of its origin against gravity, (T, 3) [m/s²].
        slide: Jacobian of its origin, (T, 3, nv).
        turn: of its rotation, (T, 3, nv).
    """

    spin: Float[np.ndarray, "sample 3"]
    turning: Float[np.ndarray, "sample 3"]
    lifting: Float[np.ndarray, "sample 3"]
    slide: Float[np.ndarray, "sample 3 dof"]
    turn: Float[np.ndarray, "sample 3 dof"]


@lru_cache(maxsize=4)
def kinematics(motion: Motion) -> dict[str, Moved]:
    """Motion of each body of a machine, by name."""
    m, d = mujoco.MjModel.__copy__(motion.scene.model), motion.scene.data
    n, nv, kind = len(motion), m.nv, mujoco.mjtObj.mjOBJ_XBODY
    names = motion.scene.moving
    ids = [m.body(name).id for name in names]
    velocity, acceleration = np.empty((2, len(names), n, 6))
    jacobian = np.empty((len(names), n, 2, 3, nv))
    for k in range(n):
        d.qpos[:], d.qvel[:], d.qacc[:] = motion.q[k], motion.v[k], motion.a[k]
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_comVel(m, d)
        mujoco.mj_rnePostConstraint(m, d)
        for b, i in enumerate(ids):
            mujoco.mj_objectVelocity(m, d, kind, i, velocity[b, k], 1)
            mujoco.mj_objectAcceleration(m, d, kind, i, acceleration[b, k], 1)
            mujoco.mj_jacBody(m, d, jacobian[b, k, 0], jacobian[b, k, 1], i)
            jacobian[b, k] = d.xmat[i].reshape(3, 3).T @ jacobian[b, k]
    return {
        name: Moved(
            velocity[b, :, :3],
            acceleration[b, :, :3],
            acceleration[b, :, 3:],
            jacobian[b, :, 0],
            jacobian[b, :, 1],
        )
        for b, name in enumerate(names)
    }
