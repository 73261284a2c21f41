"""Inverse kinematics of the robots on legs: joint angles for given positions of the feet.

All for several poses of the trunk at once. Frames: ``trunk`` is that of the free joint's body, the
world is level with the floor at height 0.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.prove import legged_rigs as rigs


def rotation(
    roll: Float[np.ndarray, " sample"],
    pitch: Float[np.ndarray, " sample"],
    yaw: Float[np.ndarray, " sample"],
) -> Float[np.ndarray, "sample 3 3"]:
    """R_z(yaw)·R_y(pitch)·R_x(roll) from angles [rad]."""
    return _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)


def _about(axis: int, angle: Float[np.ndarray, " sample"]) -> Float[np.ndarray, "sample 3 3"]:
    """Rotations about a coordinate axis by angles [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    matrices = np.zeros((len(c), 3, 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrices[:, axis, axis] = 1.0
    matrices[:, a, a] = matrices[:, b, b] = c
    matrices[:, a, b], matrices[:, b, a] = -s, s
    return matrices


def paw(leg: str, foot: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "sample 3"]:
    """Angles of a quadruped's leg: abduction, hip, knee.

    Args:
        leg: its name, FL to RR.
        foot: middle of its foot in the trunk's frame [m].

    Returns:
        Angles [rad]; a foot out of reach is reached for.
    """
    x, y = (1 if leg[0] == "F" else -1), (1 if leg[1] == "L" else -1)
    p = foot - np.array([x * rigs.HIP_AT[0], y * rigs.HIP_AT[1], 0.0])
    aside = y * rigs.HIP_ASIDE
    deep = np.sqrt(np.maximum(p[:, 1] ** 2 + p[:, 2] ** 2 - aside**2, 1e-4))
    # (y, z) = R(a)·(aside, −deep)
    a = np.arctan2(p[:, 2], p[:, 1]) - np.arctan2(-deep, np.full_like(deep, aside))
    a = (a + np.pi) % (2 * np.pi) - np.pi
    far = np.minimum(np.hypot(p[:, 0], deep), 0.995 * (rigs.THIGH + rigs.SHANK))
    knee = -_triangle(far, rigs.THIGH, rigs.SHANK)
    # thigh and shank are equally long, so the foot lies half the knee's angle off the thigh
    hip = np.arctan2(-p[:, 0], deep) - 0.5 * knee
    return np.stack([a, hip, knee], axis=1)


def _triangle(
    far: Float[np.ndarray, " sample"], upper: float, lower: float
) -> Float[np.ndarray, " sample"]:
    """Bend of a knee for a distance between the ends of the leg [rad]."""
    cosine = (far**2 - upper**2 - lower**2) / (2 * upper * lower)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def leg(
    side: str, ankle: Float[np.ndarray, "sample 3"], turn: Float[np.ndarray, "sample 3 3"]
) -> Float[np.ndarray, "sample 6"]:
    """Angles of a humanoid's leg: hip yaw, roll, pitch, knee, ankle pitch, roll.

    Args:
        side: left or right.
        ankle: position of the ankle in the pelvis's frame [m].
        turn: rotation of the sole in the pelvis's frame.

    Returns:
        Angles [rad].
    """
    y = 1.0 if side == "left" else -1.0
    hip = np.array([0.0, y * rigs.PELVIS_AT[0], rigs.PELVIS_AT[1]])
    # the hip as the sole sees it: r = turnᵀ·(hip − ankle)
    r = np.einsum("nji,nj->ni", turn, hip - ankle)
    far = np.minimum(np.linalg.norm(r, axis=1), 0.995 * (rigs.FEMUR + rigs.TIBIA))
    knee = _triangle(far, rigs.FEMUR, rigs.TIBIA)
    # thigh and shin are equally long, so the ankle stands half the knee's angle off that line
    roll = np.arctan2(r[:, 1], r[:, 2])
    pitch = -np.arctan2(r[:, 0], np.hypot(r[:, 1], r[:, 2])) - 0.5 * knee
    # turn = Rz(yaw)·Rx(hip roll)·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll)
    rest = turn @ _about(0, -roll) @ _about(1, -(knee + pitch))
    # Rz(a)·Rx(b)·Ry(c): element (2, 1) is sin b, the second column (−sin a·cos b, cos a·cos b)
    b = np.arcsin(np.clip(rest[:, 2, 1], -1.0, 1.0))
    a = np.arctan2(-rest[:, 0, 1], rest[:, 1, 1])
    c = np.arctan2(-rest[:, 2, 0], rest[:, 2, 2])
    return np.stack([a, b, c, knee, pitch, roll], axis=1)
