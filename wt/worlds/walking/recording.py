"""Recordings of walking robots, as encoders and an estimator of the trunk give them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from wt.types import Recording
from wt.worlds.legged import Herd
from wt.worlds.legged_model import BASE

RATE_HZ = 200.0
"""Rate of the samples [Hz]; every physics step, where these are longer."""
POSITION, TURN = 5e-4, 1e-3
"""Noise of the trunk's position [m] and of its orientation about each axis [rad], rms."""
VELOCITY, TURNING = 1e-2, 3e-3
"""Noise of its velocity [m/s] and of its angular velocity [rad/s], rms."""
ENCODER, SPEED = 2e-4, 1e-2
"""Noise of joint positions [rad] and velocities [rad/s], rms."""


class HerdRecorder:
    """Watches the first robots of a herd; see ``watch`` of :meth:`Herd.step`."""

    def __init__(self, herd: Herd, robots: int) -> None:
        """Begin with nothing.

        Args:
            herd: the robots.
            robots: number of them that are watched.
        """
        self._herd, self._robots = herd, robots
        self._every = max(1, round(1.0 / (RATE_HZ * herd.model.opt.timestep)))
        self._calls = 0
        self._rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def __call__(self) -> None:
        """Keep the present state, and the command that is in force from now on."""
        if self._calls % self._every == 0:
            herd, n = self._herd, self._robots
            self._rows.append(tuple(x[:n].copy() for x in (herd.qpos, herd.qvel, herd.ctrl)))
        self._calls += 1

    def recording(self, robot: int, rng: np.random.Generator) -> Recording:
        """The measurements of one robot.

        Args:
            robot: its index, below the number that is watched.
            rng: of the noise.
        """
        herd = self._herd
        qpos, qvel, ctrl = (np.array([row[i][robot] for row in self._rows]) for i in range(3))
        n = len(qpos)
        place = qpos[:, :3] + rng.normal(0, POSITION, (n, 3))
        turned = Rotation.from_quat(qpos[:, 3:7], scalar_first=True) * Rotation.from_rotvec(
            rng.normal(0, TURN, (n, 3))
        )
        pose = np.hstack([place, turned.as_quat(scalar_first=True)])
        twist = qvel[:, :6] + rng.normal(0, 1, (n, 6)) * np.repeat([VELOCITY, TURNING], 3)
        columns = {f"qpos/{BASE}/{i}": pose[:, i] for i in range(7)}
        columns |= {f"qvel/{BASE}/{i}": twist[:, i] for i in range(6)}
        for name, q, v in zip(herd.robot.joints, herd.q, herd.v, strict=True):
            columns[f"qpos/{name}"] = qpos[:, q] + rng.normal(0, ENCODER, n)
            columns[f"qvel/{name}"] = qvel[:, v] + rng.normal(0, SPEED, n)
            columns[f"ctrl/{name}"] = ctrl[:, herd.model.actuator(name).id]
        t = np.arange(n) * self._every * herd.model.opt.timestep
        return Recording(t, columns, {"robot": herd.robot.name, "rate": 1.0 / (t[1] - t[0])})
