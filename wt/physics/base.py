"""A free joint as three slides and three hinges, so that every coordinate of a machine is a number.

Positions of scalar joints subtract, interpolate and have splines; quaternions do none of it. So a
floating base is taken apart before anything is computed: ``<freejoint name="base"/>`` becomes the
slides ``base/x``, ``base/y``, ``base/z`` along the world's axes and the hinges ``base/yaw``,
``base/pitch``, ``base/roll`` (rotation Rz·Ry·Rx of the body in the world). The machine is the same
one, as long as it does not stand on its head: at a pitch of ±90° yaw and roll cannot be told apart.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from wt.physics.parts import add_joint

COORDINATES = ("x", "y", "z", "yaw", "pitch", "roll")
"""In this order, as ``<joint>/<coordinate>``."""
_AXES = np.vstack([np.eye(3), np.eye(3)[::-1]])


def names(joint: str) -> tuple[str, ...]:
    """Names of the six joints that stand for a free joint."""
    return tuple(f"{joint}/{c}" for c in COORDINATES)


def expand(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Take every free joint of a spec apart, in place; keyframes, which do not fit any more, go.

    Returns:
        Names of the free joints.
    """
    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    for key in list(spec.keys) if free else ():
        spec.delete(key)
    added = []
    for joint in free:
        body, name = joint.parent, joint.name
        spec.delete(joint)
        body.pos, body.quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        for i, (part, axis) in enumerate(zip(names(name), _AXES, strict=True)):
            kind = mujoco.mjtJoint.mjJNT_SLIDE if i < 3 else mujoco.mjtJoint.mjJNT_HINGE
            add_joint(spec, body, part, type=kind, axis=axis)
        added.append(name)
    return tuple(added)


def coordinates(
    joint: str, columns: Mapping[str, Float[np.ndarray, " sample"]]
) -> dict[str, Float[np.ndarray, " sample"]]:
    """The six coordinates and their rates from the columns of a recording.

    Args:
        joint: the free joint's name.
        columns: of the recording, (K,) each: position [m] and quaternion (w, x, y, z) as
            ``qpos/<joint>/0…6``; linear velocity in the world and angular in the body as
            ``qvel/<joint>/0…5``, which may be missing.

    Returns:
        ``qpos/<joint>/x`` and so on, (K,) each [m, rad]; NaN where a sample is missing.
    """
    q = [columns.get(f"qpos/{joint}/{k}") for k in range(7)]
    given = [x for x in q if x is not None]
    if len(given) < 7:
        return {}
    quaternion = np.stack(given[3:], axis=1)
    known = np.isfinite(quaternion).all(axis=1) & (np.linalg.norm(quaternion, axis=1) > 0.5)
    angles = np.full((len(quaternion), 3), np.nan)
    angles[known] = Rotation.from_quat(quaternion[known], scalar_first=True).as_euler("ZYX")
    angles[known] = np.unwrap(angles[known], axis=0)
    table = dict(zip(names(joint), [*given[:3], *angles.T], strict=True))
    coordinate = {f"qpos/{name}": x for name, x in table.items()}
    v = [x for k in range(6) if (x := columns.get(f"qvel/{joint}/{k}")) is not None]
    if len(v) == 6:
        turning = rates(angles, np.stack(v[3:], axis=1))
        coordinate |= {
            f"qvel/{n}": x for n, x in zip(names(joint), [*v[:3], *turning.T], strict=True)
        }
    return coordinate


def rates(
    angles: Float[np.ndarray, "sample 3"], omega: Float[np.ndarray, "sample 3"]
) -> Float[np.ndarray, "sample 3"]:
    """Rates of yaw, pitch and roll, (K, 3), from the body's own angular velocity.

    Args:
        angles: yaw, pitch and roll, (K, 3) [rad].
        omega: in the body's frame, (K, 3) [rad/s].
    """
    _, pitch, roll = angles.T
    side = omega[:, 1] * np.sin(roll) + omega[:, 2] * np.cos(roll)
    yaw = side / np.cos(pitch)
    nod = omega[:, 1] * np.cos(roll) - omega[:, 2] * np.sin(roll)
    return np.stack([yaw, nod, omega[:, 0] + yaw * np.sin(pitch)], axis=1)


def pose(coordinates_: Float[np.ndarray, "*batch 6"]) -> Float[np.ndarray, "*batch 7"]:
    """Position and quaternion (w, x, y, z) of the free joint, (…, 7), from the six, (…, 6)."""
    turned = Rotation.from_euler("ZYX", coordinates_[..., 3:].reshape(-1, 3))
    quaternion = turned.as_quat(scalar_first=True).reshape(*coordinates_.shape[:-1], 4)
    return np.concatenate([coordinates_[..., :3], quaternion], axis=-1)
