"""Recordings of a robot's trunk: an estimator or motion capture, and an IMU."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.prove.legged_rigs import BASE
from wt.prove.trajectory import HiddenTrajectory


@dataclass(frozen=True)
class BaseSensing:
    """Sensors of the trunk; all Gaussian noise, rms.

    Attributes:
        position: of its position [m].
        turn: of its orientation, about each axis [rad].
        velocity: of its velocity [m/s].
        rate: of its angular velocity, and of the gyro [rad/s].
        acceleration: of the accelerometer [m/s²].
        imu: whether ``sensor/gyro/0…2`` and ``sensor/accelerometer/0…2`` are recorded.
    """

    position: float
    turn: float
    velocity: float
    rate: float
    acceleration: float = 0.05
    imu: bool = False


def measure_base(
    sensing: BaseSensing, trace: HiddenTrajectory, velocities: bool, rng: np.random.Generator
) -> dict[str, Float[np.ndarray, " sample"]]:
    """The columns of the trunk.

    Args:
        sensing: its sensors.
        trace: the trajectory.
        velocities: whether they are recorded.
        rng: decides the noise.

    Returns:
        ``qpos/base/0…6``, ``qvel/base/0…5`` and the IMU's.
    """
    n = len(trace.base_q)
    place = trace.base_q[:, :3] + rng.normal(0, sensing.position, (n, 3))
    turned = _turned(trace.base_q[:, 3:], rng.normal(0, sensing.turn, (n, 3)))
    pose = np.concatenate([place, turned], axis=1)
    noise = np.repeat([sensing.velocity, sensing.rate], 3)
    speed = trace.base_v + rng.normal(0, 1, (n, 6)) * noise
    columns = {f"qpos/{BASE}/{i}": pose[:, i] for i in range(7)}
    if velocities:
        columns |= {f"qvel/{BASE}/{i}": speed[:, i] for i in range(6)}
    if sensing.imu:
        noise = np.repeat([sensing.rate, sensing.acceleration], 3)
        imu = trace.sensors + rng.normal(0, 1, (n, 6)) * noise
        names = [f"sensor/{name}/{i}" for name in ("gyro", "accelerometer") for i in range(3)]
        columns |= {name: imu[:, i] for i, name in enumerate(names)}
    return columns


def _turned(
    quaternion: Float[np.ndarray, "sample 4"], by: Float[np.ndarray, "sample 3"]
) -> Float[np.ndarray, "sample 4"]:
    """Quaternions wxyz, turned in the body by small rotation vectors [rad]."""
    w, v = quaternion[:, :1], quaternion[:, 1:]
    half = 0.5 * by
    # (w, v)·(1, h) = (w − v·h, w·h + v + v × h)
    out = np.concatenate(
        [w - (v * half).sum(axis=1, keepdims=True), w * half + v + np.cross(v, half)], axis=1
    )
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
