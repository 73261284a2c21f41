"""The true trajectory of a hidden world, before any sensor."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


class HiddenTrajectory:
    """True motion and torques, at the samples and at every fine step.

    Attributes:
        q: positions at the samples [rad].
        v: velocities [rad/s].
        u: commands in force from each sample.
        sensors: MuJoCo's sensordata: encoder [rad] and gyro [rad/s] of an arm, gyro and
            accelerometer [m/s²] of a robot on legs.
        base_q: of a robot on legs the trunk's position [m] and quaternion wxyz.
        base_v: its velocity in the world [m/s] and angular velocity in the body [rad/s].
        fine_q: positions at every step [rad]; ``fine_v`` and ``fine_tau`` likewise
            velocities and drive torques.
    """

    q: Float[np.ndarray, "sample joint"]
    v: Float[np.ndarray, "sample joint"]
    u: Float[np.ndarray, "sample joint"]
    sensors: Float[np.ndarray, "sample sensor"]
    base_q: Float[np.ndarray, "sample 7"]
    base_v: Float[np.ndarray, "sample 6"]
    fine_q: Float[np.ndarray, "step joint"]
    fine_v: Float[np.ndarray, "step joint"]
    fine_tau: Float[np.ndarray, "step joint"]

    def __init__(self, samples: int, joints: int, steps: int, h: float, sensors: int = 4) -> None:
        """Empty arrays."""
        self.h = h
        self.q, self.v, self.u = (np.zeros((samples, joints)) for _ in range(3))
        self.sensors = np.zeros((samples, sensors))
        self.base_q, self.base_v = np.zeros((samples, 7)), np.zeros((samples, 6))
        self.fine_q, self.fine_v, self.fine_tau = (np.zeros((steps, joints)) for _ in range(3))

    def put(
        self,
        row: int,
        q: Float[np.ndarray, " joint"],
        v: Float[np.ndarray, " joint"],
        u: Float[np.ndarray, " joint"],
        sensors: Float[np.ndarray, " sensor"],
    ) -> None:
        """Store one sample."""
        self.q[row], self.v[row], self.u[row], self.sensors[row] = q, v, u, sensors
