"""Feet that stand keep standing when a robot's observation of itself is overwritten.

New joint angles and angular velocities alone would lift, press down and drag the feet that carry
the robot, and a millimetre of a foot in the ground is a force of its own. So the trunk's height and
linear velocity, which no sensor of the robot tells, are moved by as much as the standing feet would
otherwise move: leg odometry, run from S's answer to the state that takes its place.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from wt.worlds.legged import LeggedRobot

LOADED = 0.004
"""Height above the ground over which a foot ceases to count as standing [m]."""
HEIGHT, HEADING, VELOCITY = 2, 3, slice(4, 7)
"""Indices of the trunk's height, heading and velocity in hidden variables."""


class FootKinematics:
    """Places and velocities of one robot's feet, from the robot's observation of itself."""

    def __init__(self, robot: LeggedRobot, model: mujoco.MjModel) -> None:
        """Prepare for one model.

        Args:
            robot: whose joints are observed.
            model: what it is part of.
        """
        self._model, self._data = model, mujoco.MjData(model)
        self._rest = robot.foot_rest
        self._sites = [model.site(name).id for name in robot.feet]
        self._q, self._v = robot.addresses(model)

    def motion(
        self, s: Float[np.ndarray, "robot state"], heading: Float[np.ndarray, " robot"]
    ) -> tuple[Float[np.ndarray, "robot foot xyz=3"], Float[np.ndarray, "robot foot xyz=3"]]:
        """Feet of robots whose trunk rests at the origin.

        Args:
            s: state channels (angular velocity, direction of gravity, joint positions and
                velocities), and maybe more behind them.
            heading: of the trunks [rad].

        Returns:
            Places along the world's axes [m], and velocities along the trunk's [m/s].
        """
        model, data, n = self._model, self._data, len(self._q)
        turn = upright(s[:, 3:6].astype(float), heading)
        place = np.empty((len(s), len(self._sites), 3))
        velocity = np.empty_like(place)
        observed, twist = s.astype(float), np.zeros(6)
        quats = Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
        data.qpos[:3], data.qvel[:] = 0.0, 0.0
        for i, (row, quat) in enumerate(zip(observed, quats, strict=True)):
            data.qpos[3:7], data.qpos[self._q] = quat, row[6 : 6 + n]
            data.qvel[3:6], data.qvel[self._v] = row[:3], row[6 + n : 6 + 2 * n]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            place[i] = data.site_xpos[self._sites]
            for k, site in enumerate(self._sites):
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
                velocity[i, k] = twist[3:]
        velocity = np.einsum("nji,nfj->nfi", turn, velocity)
        return place, velocity

    def standing(
        self, s: Float[np.ndarray, "robot state"], hidden: Float[np.ndarray, "robot hidden"]
    ) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables of robots on flat ground whose lowest foot carries them and is at rest.

        Args:
            s: state channels, and maybe more behind them.
            hidden: hidden variables, of which height and velocity are replaced.
        """
        place, velocity = self.motion(s, hidden[:, HEADING])
        rows, out = np.arange(len(s)), hidden.copy()
        lowest = place[:, :, 2].argmin(axis=1)
        out[:, HEIGHT] = self._rest - place[rows, lowest, 2]
        out[:, VELOCITY] = -velocity[rows, lowest]
        return out

    def kept(
        self,
        answer: Float[np.ndarray, "robot state"],
        target: Float[np.ndarray, "robot state"],
        hidden: Float[np.ndarray, "robot hidden"],
        ground: Callable[[np.ndarray, np.ndarray], np.ndarray | float],
    ) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables with which the feet that stand in S's answer do so in its place too.

        Args:
            answer: S's state channels.
            target: state channels that overwrite them.
            hidden: S's hidden variables after the step.
            ground: height of the terrain [m] at any number of places x and y [m].

        Returns:
            The same, the trunk's height and velocity moved. Where no foot is near the ground,
            nothing is.
        """
        heading, out = hidden[:, HEADING].astype(float), hidden.copy()
        before, after = self.motion(answer, heading), self.motion(target, heading)
        at = before[0] + hidden[:, None, :3]
        above = at[:, :, 2] - self._rest - ground(at[:, :, 0], at[:, :, 1])
        loaded = np.exp(-np.maximum(above, 0.0) / LOADED)
        share = loaded / np.maximum(loaded.sum(axis=1, keepdims=True), 1.0)
        moved = [np.einsum("nf,nfi->ni", share, b - a) for b, a in zip(before, after, strict=True)]
        out[:, HEIGHT] += moved[0][:, 2]
        out[:, VELOCITY] += moved[1]
        return out


def upright(
    gravity: Float[np.ndarray, "robot xyz=3"], heading: Float[np.ndarray, " robot"]
) -> Float[np.ndarray, "robot 3 3"]:
    """Rotation matrices of trunks, from the direction of gravity and the heading.

    Args:
        gravity: its direction in the trunk's frame, of about unit length.
        heading: of the trunk's x axis seen from above [rad].
    """
    z = -gravity / np.linalg.norm(gravity, axis=1, keepdims=True)
    y = np.cross(z, (1.0, 0.0, 0.0))
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    level = np.stack([np.cross(y, z), y, z], axis=1)  # rows: axes of the heading frame
    cos, sin, zero = np.cos(heading), np.sin(heading), np.zeros(len(heading))
    about = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0], axis=1)
    return np.asarray(about.reshape(-1, 3, 3) @ level)
