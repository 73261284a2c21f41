"""What a walking robot's own sensors do not say of its state, and how a state is put together.

Hidden are where the trunk is, where it heads, how fast it moves and, with a payload, where the ball
is in the box and how it rolls. With the observation they are the whole state of the simulation.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wt.types import Channel
from wt.worlds.legged import Herd, Robot

Array = np.ndarray

_TRUNK = (
    *(Channel(f"position/{axis}", "m") for axis in "xyz"),
    Channel("heading", "rad"),
    *(Channel(f"velocity/{axis}", "m/s") for axis in "xyz"),
)
_BALL = (
    *(Channel(f"ball/position/{axis}", "m") for axis in "xyz"),
    *(Channel(f"ball/velocity/{axis}", "m/s") for axis in "xyz"),
    *(Channel(f"ball/spin/{axis}", "rad/s") for axis in "xyz"),
)


class WalkingState:
    """Reads hidden variables off a herd, and sets a herd to observations and hidden variables.

    Attributes:
        channels: of the hidden variable: position [m] and heading [rad] of the trunk in the world,
            its velocity [m/s] along its own axes; with a ball, place and velocity of the ball
            relative to the trunk, along the trunk's axes, and its angular velocity in the world.
    """

    def __init__(self, robot: Robot, ball: bool) -> None:
        """Prepare for a robot with or without a ball."""
        self._robot, self._ball = robot, ball
        self.channels = (*_TRUNK, *_BALL) if ball else _TRUNK

    def hidden(self, herd: Herd) -> Array:
        """Hidden variables of all robots, (N, n_hidden)."""
        turn = _rotation(herd.qpos[:, 3:7])
        axis = turn[:, :, 0]
        velocity = _into(turn, herd.qvel[:, :3])
        found = [herd.qpos[:, :3], np.arctan2(axis[:, 1], axis[:, 0])[:, None], velocity]
        if self._ball:
            at, to = herd.qpos[:, -7:-4], herd.qvel[:, -6:-3]
            spin = np.einsum("nij,nj->ni", _rotation(herd.qpos[:, -4:]), herd.qvel[:, -3:])
            found += [_into(turn, at - herd.qpos[:, :3]), _into(turn, to) - velocity, spin]
        return np.concatenate(found, axis=1)

    def restore(self, herd: Herd, o: Array, hidden: Array | None) -> None:
        """Set robots to observations (N, n_obs) and hidden variables (N, n_hidden).

        Args:
            herd: at least N robots; the first N are set, the others stand.
            o: observations; the last action is the next step's business.
            hidden: None for what :meth:`nominal` says.
        """
        rows = np.arange(len(o))
        herd.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        h = self.nominal(herd, o) if hidden is None else hidden.astype(float)
        self._set(herd, rows, o, h)

    def overwrite(self, herd: Herd, s: Array, hidden: Array, rows: Array) -> None:
        """Set what robots observe of themselves, and leave what else the simulation keeps.

        Args:
            herd: N robots.
            s: state channels of all of them, (N, n_state): angular velocity, direction of gravity,
                joint positions and velocities.
            hidden: their hidden variables as they are, :meth:`hidden`, and will be.
            rows: which are set, (K,) integers.
        """
        self._set(herd, rows, s[rows], hidden[rows])

    def _set(self, herd: Herd, rows: Array, o: Array, h: Array) -> None:
        n = len(self._robot.joints)
        turn = upright(o[:, 3:6].astype(float), h[:, 3])
        quat = Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
        velocity = h[:, 4:7]
        qpos, qvel = herd.qpos[rows], herd.qvel[rows]
        qpos[:, :3], qpos[:, 3:7], qpos[:, 7 : 7 + n] = h[:, :3], quat, o[:, 6 : 6 + n]
        qvel[:, :3], qvel[:, 3:6] = np.einsum("nij,nj->ni", turn, velocity), o[:, :3]
        qvel[:, 6 : 6 + n] = o[:, 6 + n : 6 + 2 * n]
        if self._ball:
            qpos[:, -7:-4] = h[:, :3] + np.einsum("nij,nj->ni", turn, h[:, 7:10])
            qpos[:, -4:] = (1.0, 0.0, 0.0, 0.0)
            qvel[:, -6:-3] = np.einsum("nij,nj->ni", turn, velocity + h[:, 10:13])
            qvel[:, -3:] = h[:, 13:16]  # of a ball that is not turned, its frame is the world's
        herd.qpos[rows], herd.qvel[rows] = qpos, qvel

    def nominal(self, herd: Herd, o: Array) -> Array:
        """What is believed of the hidden variables where nothing is known, (N, n_hidden).

        The robot stands on flat ground at the origin, on its lowest foot, which is at rest; a ball
        lies still in the middle of its box.
        """
        robot, model = self._robot, herd.model
        data, n = mujoco.MjData(model), len(robot.joints)
        feet = [model.site(name).id for name in robot.feet]
        out = np.zeros((len(o), len(self.channels)))
        turn = upright(o[:, 3:6].astype(float), np.zeros(len(o)))
        rest = self._ball_at_rest(model)
        jacobian = np.zeros((3, model.nv))
        for k, (row, frame) in enumerate(zip(o.astype(float), turn, strict=True)):
            data.qpos[:3] = 0.0
            data.qpos[3:7] = Rotation.from_matrix(frame).as_quat()[[3, 0, 1, 2]]
            data.qpos[7 : 7 + n] = row[6 : 6 + n]
            data.qvel[:] = 0.0
            data.qvel[3:6], data.qvel[6 : 6 + n] = row[:3], row[6 + n : 6 + 2 * n]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            lowest = min(feet, key=lambda site: float(data.site_xpos[site][2]))
            mujoco.mj_jacSite(model, data, jacobian, None, lowest)
            out[k, 2] = robot.foot_rest - data.site_xpos[lowest][2]
            out[k, 4:7] = -frame.T @ (jacobian @ data.qvel)
            if self._ball:
                out[k, 7:10] = rest
        return out

    def _ball_at_rest(self, model: mujoco.MjModel) -> Array:
        """Place of the ball in the trunk's frame, from the keyframe in which the robot stands."""
        if not self._ball:
            return np.zeros(3)
        pose = model.key(0).qpos
        return np.asarray(pose[-7:-4] - pose[:3])


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


def _rotation(quat: Array) -> Array:
    """Rotation matrices of quaternions wxyz, (N, 3, 3)."""
    return np.asarray(Rotation.from_quat(quat[:, [1, 2, 3, 0]]).as_matrix())


def _into(turn: Array, vector: Array) -> Array:
    """World vectors (N, 3) along the axes of frames (N, 3, 3)."""
    return np.asarray(np.einsum("nji,nj->ni", turn, vector))
