"""What a walking robot's own sensors do not say of its state, and how a state is put together.

Hidden are where the trunk is, where it heads and how fast it moves; with a ball in a box, where the
ball is and how it rolls; and whatever else moves in a model, as the load on slides that a diagnosis
puts in. With the observation they are the whole state of the simulation.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wt.types import Channel
from wt.worlds.go2_model import BALL
from wt.worlds.legged import Herd, LeggedRobot
from wt.worlds.legged_model import BASE, STAND
from wt.worlds.stance import HEADING, VELOCITY, FootKinematics, upright

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
TRUNK = len(_TRUNK)
"""So many channels of every hidden variable are the trunk's, the first ones."""


class WalkingState:
    """Reads hidden variables off a herd, and sets a herd to observations and hidden variables.

    Attributes:
        channels: of the hidden variable: position [m] and heading [rad] of the trunk in the world,
            its velocity [m/s] along its own axes; with a ball, place and velocity of the ball
            relative to the trunk, along the trunk's axes, and its angular velocity in the world;
            then positions and velocities of the other slides [m, m/s] and hinges [rad, rad/s].
        feet: where they are, from what is observed.
        rest: what is hidden beyond the trunk, where nothing is known of it: a ball lies still in
            the middle of its box, all else as it does where the robot stands.
    """

    def __init__(self, robot: LeggedRobot, model: mujoco.MjModel) -> None:
        """Prepare for one model.

        Args:
            robot: whose joints are observed.
            model: everything that moves in it.
        """
        self._robot, self._ball, self.feet = robot, False, FootKinematics(robot, model)
        stand = model.key(STAND).qpos
        joints = [model.joint(i) for i in range(model.njnt)]
        others = [joint for joint in joints if joint.name not in (BASE, BALL, *robot.joints)]
        self._q = np.array([int(joint.qposadr[0]) for joint in others], int)
        self._v = np.array([int(joint.dofadr[0]) for joint in others], int)
        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        units = ["m" if int(joint.type[0]) == slide else "rad" for joint in others]
        named = [(joint.name, unit) for joint, unit in zip(others, units, strict=True)]
        channels = (
            *(Channel(f"qpos/{name}", unit) for name, unit in named),
            *(Channel(f"qvel/{name}", f"{unit}/s") for name, unit in named),
        )
        rest = np.concatenate([stand[self._q], np.zeros(len(others))])
        for joint in joints:
            if joint.name == BALL:
                self._ball = True
                self._ball_q, self._ball_v = int(joint.qposadr[0]), int(joint.dofadr[0])
                channels = (*_BALL, *channels)
                at = stand[self._ball_q : self._ball_q + 3] - stand[:3]
                rest = np.concatenate([at, np.zeros(6), rest])
        self.channels, self.rest = (*_TRUNK, *channels), rest

    def hidden(self, herd: Herd) -> Array:
        """Hidden variables of all robots, (N, n_hidden)."""
        turn = _rotation(herd.qpos[:, 3:7])
        axis = turn[:, :, 0]
        velocity = _into(turn, herd.qvel[:, :3])
        found = [herd.qpos[:, :3], np.arctan2(axis[:, 1], axis[:, 0])[:, None], velocity]
        if self._ball:
            pose, twist = herd.qpos[:, self._ball_q :][:, :7], herd.qvel[:, self._ball_v :][:, :6]
            spin = np.einsum("nij,nj->ni", _rotation(pose[:, 3:]), twist[:, 3:])
            at, to = pose[:, :3], twist[:, :3]
            found += [_into(turn, at - herd.qpos[:, :3]), _into(turn, to) - velocity, spin]
        found += [herd.qpos[:, self._q], herd.qvel[:, self._v]]
        return np.concatenate(found, axis=1)

    def restore(self, herd: Herd, o: Array, hidden: Array | None) -> None:
        """Set robots to observations (N, n_obs) and hidden variables (N, n_hidden).

        Args:
            herd: at least N robots; the first N are set, the others stand.
            o: observations; the last action is the next step's business.
            hidden: None for what :meth:`nominal` says; beyond the trunk's channels, what is NaN or
                not there is at :attr:`rest`.
        """
        rows = np.arange(len(o))
        herd.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        h = self.nominal(o) if hidden is None else self._completed(hidden)
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
        turn = upright(o[:, 3:6].astype(float), h[:, HEADING])
        quat = Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
        velocity, n = h[:, VELOCITY], len(self._robot.joints)
        qpos, qvel = herd.qpos[rows], herd.qvel[rows]
        qpos[:, :3], qpos[:, 3:7], qpos[:, herd.q] = h[:, :3], quat, o[:, 6 : 6 + n]
        qvel[:, :3], qvel[:, 3:6] = np.einsum("nij,nj->ni", turn, velocity), o[:, :3]
        qvel[:, herd.v] = o[:, 6 + n : 6 + 2 * n]
        if self._ball:
            pose, twist = qpos[:, self._ball_q :][:, :7], qvel[:, self._ball_v :][:, :6]
            at, to, spin = (h[:, TRUNK + 3 * i : TRUNK + 3 * i + 3] for i in range(3))
            pose[:, :3] = h[:, :3] + np.einsum("nij,nj->ni", turn, at)
            pose[:, 3:] = (1.0, 0.0, 0.0, 0.0)
            twist[:, :3] = np.einsum("nij,nj->ni", turn, velocity + to)
            twist[:, 3:] = spin  # of a ball that is not turned, its frame is the world's
        inner = len(self._q)
        qpos[:, self._q] = h[:, h.shape[1] - 2 * inner : h.shape[1] - inner]
        qvel[:, self._v] = h[:, h.shape[1] - inner :]
        herd.qpos[rows], herd.qvel[rows] = qpos, qvel

    def nominal(self, o: Array) -> Array:
        """What is believed of the hidden variables where nothing is known, (N, n_hidden).

        The robot stands on flat ground at the origin, on its lowest foot, which is at rest; a ball
        lies still in the middle of its box, and all else is at :attr:`rest` too.
        """
        unknown = np.concatenate([np.zeros(TRUNK), self.rest])
        return self.feet.standing(o, np.tile(unknown, (len(o), 1)))

    def _completed(self, hidden: Array) -> Array:
        """Hidden variables with what is at rest where they say nothing, (N, n_hidden)."""
        beyond = np.full((len(hidden), len(self.rest)), np.nan)
        if hidden.shape[1] == len(self.channels):
            beyond = hidden[:, TRUNK:].astype(float)
        known = np.where(np.isnan(beyond), self.rest, beyond)
        return np.hstack([hidden[:, :TRUNK].astype(float), known])


def _rotation(quat: Array) -> Array:
    """Rotation matrices of quaternions wxyz, (N, 3, 3)."""
    return np.asarray(Rotation.from_quat(quat[:, [1, 2, 3, 0]]).as_matrix())


def _into(turn: Array, vector: Array) -> Array:
    """World vectors (N, 3) along the axes of frames (N, 3, 3)."""
    return np.asarray(np.einsum("nji,nj->ni", turn, vector))
