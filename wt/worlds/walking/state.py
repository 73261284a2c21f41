"""The hidden part of a walking robot's state, and putting a state together from both parts.

Hidden from its own sensors are where the trunk is, where it heads and how fast it moves; with a
ball in a box, where the ball is and how it rolls; and whatever else moves in a model, as the load
on slides that a diagnosis puts in. With the observation they are the whole state of the simulation.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from wt.types import Channel
from wt.worlds.go2_model import BALL
from wt.worlds.legged import Herd, LeggedRobot
from wt.worlds.legged_model import BASE, STAND
from wt.worlds.stance import HEADING, VELOCITY, FootKinematics, upright

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
"""Number of the trunk's channels, which are the first ones of every hidden variable."""


class WalkingState:
    """Reads hidden variables off a herd, and sets a herd to observations and hidden variables.

    Attributes:
        channels: of the hidden variable: position [m] and heading [rad] of the trunk in the world,
            its velocity [m/s] along its own axes; with a ball, place and velocity of the ball
            relative to the trunk, along the trunk's axes, and its angular velocity in the world;
            then positions and velocities of the other slides [m, m/s] and hinges [rad, rad/s].
        feet: their places and velocities, from what is observed.
        rest: hidden variables beyond the trunk's, where nothing is known of them: a ball lies still
            in the middle of its box, all else as it does where the robot stands.
    """

    rest: Float[np.ndarray, " inner"]

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

    def hidden(self, herd: Herd) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables of all robots."""
        turn = _rotation(herd.qpos[:, 3:7])
        axis = turn[:, :, 0]
        velocity = _into(turn, herd.qvel[:, :3])
        parts = [herd.qpos[:, :3], np.arctan2(axis[:, 1], axis[:, 0])[:, None], velocity]
        if self._ball:
            pose, twist = herd.qpos[:, self._ball_q :][:, :7], herd.qvel[:, self._ball_v :][:, :6]
            spin = np.einsum("nij,nj->ni", _rotation(pose[:, 3:]), twist[:, 3:])
            at, to = pose[:, :3], twist[:, :3]
            parts += [_into(turn, at - herd.qpos[:, :3]), _into(turn, to) - velocity, spin]
        parts += [herd.qpos[:, self._q], herd.qvel[:, self._v]]
        return np.concatenate(parts, axis=1)

    def restore(
        self,
        herd: Herd,
        o: Float[np.ndarray, "robot obs"],
        hidden: Float[np.ndarray, "robot hidden"] | None,
    ) -> None:
        """Set the first robots of a herd to observations and hidden variables; others stand.

        Args:
            herd: at least as many robots as observations.
            o: observations; the last action is the next step's business.
            hidden: None for :meth:`nominal`; beyond the trunk's channels, NaN or a missing channel
                stands for :attr:`rest`.
        """
        rows = np.arange(len(o))
        herd.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        h = self.nominal(o) if hidden is None else self._completed(hidden)
        self._set(herd, rows, o, h)

    def overwrite(
        self,
        herd: Herd,
        s: Float[np.ndarray, "robot state"],
        hidden: Float[np.ndarray, "robot hidden"],
        rows: Int[np.ndarray, " chosen"],
    ) -> None:
        """Set the observable state of some robots, and leave what else the simulation keeps.

        Args:
            herd: the robots.
            s: state channels of all of them: angular velocity, direction of gravity, joint
                positions and velocities.
            hidden: their hidden variables as they are, :meth:`hidden`, and will be.
            rows: indices of the robots that are set.
        """
        self._set(herd, rows, s[rows], hidden[rows])

    def _set(
        self,
        herd: Herd,
        rows: Int[np.ndarray, " chosen"],
        o: Float[np.ndarray, "chosen obs"],
        h: Float[np.ndarray, "chosen hidden"],
    ) -> None:
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

    def nominal(self, o: Float[np.ndarray, "robot obs"]) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables that are assumed where nothing is known of them.

        The robot stands on flat ground at the origin, on its lowest foot, which is at rest; a ball
        lies still in the middle of its box, and all else is at :attr:`rest` too.
        """
        unknown = np.concatenate([np.zeros(TRUNK), self.rest])
        return self.feet.standing(o, np.tile(unknown, (len(o), 1)))

    def _completed(
        self, hidden: Float[np.ndarray, "robot given"]
    ) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables with :attr:`rest` where they say nothing."""
        beyond = np.full((len(hidden), len(self.rest)), np.nan)
        if hidden.shape[1] == len(self.channels):
            beyond = hidden[:, TRUNK:].astype(float)
        known = np.where(np.isnan(beyond), self.rest, beyond)
        return np.hstack([hidden[:, :TRUNK].astype(float), known])


def _rotation(quat: Float[np.ndarray, "robot wxyz=4"]) -> Float[np.ndarray, "robot 3 3"]:
    """Rotation matrices of quaternions."""
    return np.asarray(Rotation.from_quat(quat[:, [1, 2, 3, 0]]).as_matrix())


def _into(
    turn: Float[np.ndarray, "robot 3 3"], vector: Float[np.ndarray, "robot xyz=3"]
) -> Float[np.ndarray, "robot xyz=3"]:
    """World vectors along the axes of frames."""
    return np.asarray(np.einsum("nji,nj->ni", turn, vector))
