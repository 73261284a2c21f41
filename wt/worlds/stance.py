"""Feet that stand keep standing when what a robot observes of itself is overwritten.

New joint angles and angular velocities alone would lift, press down and drag the feet that carry
the robot, and a millimetre of a foot in the ground is a force of its own. So the trunk's height and
linear velocity, which no sensor of the robot tells, are moved by as much as the standing feet would
otherwise move: leg odometry, run from S's answer to the state that takes its place.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wt.worlds.legged import LeggedRobot

Array = np.ndarray

LOADED = 0.004
"""Height above the ground over which a foot ceases to count as standing [m]."""
HEIGHT, HEADING, VELOCITY = 2, 3, slice(4, 7)
"""Where they are in hidden variables."""


class FootKinematics:
    """Where the feet of one robot are, and how they move, from what it observes of itself."""

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

    def motion(self, s: Array, heading: Array) -> tuple[Array, Array]:
        """Feet of robots whose trunk rests at the origin.

        Args:
            s: state channels (angular velocity, direction of gravity, joint positions and
                velocities), (N, n_state) or wider.
            heading: of the trunks, (N,) [rad].

        Returns:
            Places along the world's axes (N, feet, 3) [m], and velocities along the trunk's, (N,
            feet, 3) [m/s].
        """
        model, data, n = self._model, self._data, len(self._q)
        turn = upright(s[:, 3:6].astype(float), heading)
        place = np.empty((len(s), len(self._sites), 3))
        velocity = np.empty_like(place)
        seen, found = s.astype(float), np.zeros(6)
        quats = Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
        data.qpos[:3], data.qvel[:] = 0.0, 0.0
        for i, (row, quat) in enumerate(zip(seen, quats, strict=True)):
            data.qpos[3:7], data.qpos[self._q] = quat, row[6 : 6 + n]
            data.qvel[3:6], data.qvel[self._v] = row[:3], row[6 + n : 6 + 2 * n]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            place[i] = data.site_xpos[self._sites]
            for k, site in enumerate(self._sites):
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, found, 0)
                velocity[i, k] = found[3:]
        velocity = np.einsum("nji,nfj->nfi", turn, velocity)
        return place, velocity

    def standing(self, s: Array, hidden: Array) -> Array:
        """Trunks that stand on their lowest foot on flat ground, and move as if it were at rest.

        Args:
            s: state channels, (N, n_state) or wider.
            hidden: hidden variables, (N, n_hidden), of which height and velocity are replaced.
        """
        place, velocity = self.motion(s, hidden[:, HEADING])
        rows, out = np.arange(len(s)), hidden.copy()
        lowest = place[:, :, 2].argmin(axis=1)
        out[:, HEIGHT] = self._rest - place[rows, lowest, 2]
        out[:, VELOCITY] = -velocity[rows, lowest]
        return out

    def kept(
        self,
        answer: Array,
        target: Array,
        hidden: Array,
        ground: Callable[[Array, Array], Array | float],
    ) -> Array:
        """Hidden variables with which the feet that stand in S's answer do so in its place too.

        Args:
            answer: S's state channels, (N, n_state).
            target: those that overwrite them, (N, n_state).
            hidden: S's hidden variables after the step, (N, n_hidden).
            ground: height of the terrain at x (…) and y (…) [m].

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


def upright(gravity: Array, heading: Array) -> Array:
    """Orientation of trunks, (N, 3, 3), from the direction of gravity and the heading.

    Args:
        gravity: in the trunk's frame, (N, 3), of about unit length.
        heading: of the trunk's x axis seen from above, (N,) [rad].
    """
    z = -gravity / np.linalg.norm(gravity, axis=1, keepdims=True)
    y = np.cross(z, (1.0, 0.0, 0.0))
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    level = np.stack([np.cross(y, z), y, z], axis=1)  # rows: axes of the heading frame
    cos, sin, zero = np.cos(heading), np.sin(heading), np.zeros(len(heading))
    about = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0], axis=1)
    return np.asarray(about.reshape(-1, 3, 3) @ level)
