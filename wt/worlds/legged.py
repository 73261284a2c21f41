"""Legged robots in motion, for the training, collection and evaluation of policies.

A :class:`LeggedRobot` says what a policy may rely on. A :class:`Herd` is many simulations of one
robot, stepped together at the control rate. The observation is proprioceptive and the same
everywhere (:meth:`LeggedRobot.channels`): angular velocity of the trunk and direction of gravity in
the trunk's frame, joint positions (absolute, as an encoder reports them) and velocities, and the
last action. The command (forward and sideways velocity, turning rate) is known but no observation.

An action ``a`` is in units of the robot's ``action_scale``: drives get ``default + scale · a``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from wt.batch import Batch
from wt.errors import ConfigError
from wt.types import Channel
from wt.worlds.go2_model import BallPayload
from wt.worlds.legged_model import STAND, LeggedPhysics
from wt.worlds.terrain import Blocks, GroundHeights

RATE_HZ = 50.0
TIMESTEP = 0.005
COMMAND = ("forward", "sideways", "turn")
COMMAND_UNITS = ("m/s", "m/s", "rad/s")
"""Channels of a command: velocities in the heading frame [m/s, m/s] and turning rate [rad/s]."""


@dataclass(frozen=True)
class LeggedScene:
    """The surroundings and the load of a robot.

    Attributes:
        payload: a ball that rolls in a box on the back (Go2 only); None for nothing.
        blocks: irregular terrain; None for a flat floor.
    """

    payload: BallPayload | None = None
    blocks: Blocks | None = None


FLAT = LeggedScene()


@dataclass(frozen=True)
class LeggedRobot:
    """The facts that a walking policy may rely on.

    Attributes:
        name: of the robot, e.g. ``"go2"``.
        joints: names in the order of positions, velocities and actions; n of them.
        default: pose that the action 0 asks for, n values [rad].
        action_scale: what the action 1 adds to it, n values [rad].
        trunk: body that carries the IMU; the free joint is its.
        feet: sites at the feet.
        sole_bodies: bodies whose contacts are the feet's, unless ``sole_geoms`` names geoms.
        sole_geoms: the geoms that are the feet, where a foot's body has others.
        turns: beginning of each foot's stance in a rhythm, as a share of its period.
        height: of the trunk over the floor in the default pose [m].
        foot_rest: height of a foot's site over the floor when it stands [m].
        command: largest command either way (m/s, m/s, rad/s), as in :data:`COMMAND`.
        fall_tilt: tilt of the trunk beyond which it has fallen [rad].
        fall_height: height of the trunk over the ground below which it has fallen [m].
        physics: the published physics, with the gains that a policy is trained for.
        describe: builds the description for given physics, timestep [s] and scene.
    """

    name: str
    joints: tuple[str, ...]
    default: tuple[float, ...]
    action_scale: tuple[float, ...]
    trunk: str
    feet: tuple[str, ...]
    sole_bodies: tuple[str, ...]
    sole_geoms: tuple[str, ...]
    turns: tuple[float, ...]
    height: float
    foot_rest: float
    command: tuple[float, float, float]
    fall_tilt: float
    fall_height: float
    physics: LeggedPhysics
    describe: Callable[[LeggedPhysics, float, LeggedScene], mujoco.MjSpec]

    def channels(self) -> tuple[Channel, ...]:
        """Names and units of the observation, in order; the command is not among them."""
        n = self.joints
        return (
            *(Channel(f"gyro/{axis}", "rad/s") for axis in "xyz"),
            *(Channel(f"gravity/{axis}", "1") for axis in "xyz"),
            *(Channel(f"qpos/{joint}", "rad") for joint in n),
            *(Channel(f"qvel/{joint}", "rad/s") for joint in n),
            *(Channel(f"last_action/{joint}", "1") for joint in n),
        )

    def addresses(
        self, model: mujoco.MjModel
    ) -> tuple[Int[np.ndarray, " joint"], Int[np.ndarray, " joint"]]:
        """Addresses of its joints in ``qpos`` and in ``qvel``."""
        # by name: a model that a diagnosis has patched may have others in between
        joints = [model.joint(joint) for joint in self.joints]
        q, v = zip(*((int(j.qposadr[0]), int(j.dofadr[0])) for j in joints), strict=True)
        return np.array(q), np.array(v)

    def targets(self, action: Float[np.ndarray, "robot joint"]) -> Float[np.ndarray, "robot joint"]:
        """Joint targets [rad] that actions ask for."""
        return np.asarray(np.array(self.default) + np.array(self.action_scale) * action)

    def actions(
        self, targets: Float[np.ndarray, "robot joint"]
    ) -> Float[np.ndarray, "robot joint"]:
        """Actions that ask for joint targets [rad], the inverse of :meth:`targets`."""
        return np.asarray((targets - np.array(self.default)) / np.array(self.action_scale))


@dataclass(frozen=True)
class Start:
    """Spread of the states in which episodes begin.

    Attributes:
        joints: largest deviation from the default pose [rad].
        speed: largest velocity of the trunk along x and y [m/s], and half that of it turning.
        area: half the side of the square around the origin in which they stand [m].
    """

    joints: float = 0.0
    speed: float = 0.0
    area: float = 0.0

    def __post_init__(self) -> None:
        """Refuse negative spreads."""
        for name in ("joints", "speed", "area"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ConfigError(f"start.{name} is {getattr(self, name)}; zero or more is needed")


class Herd:
    """``size`` simulations of one robot, each with its own state, stepped together.

    Attributes:
        robot: the one in the model.
        model: the compiled model.
        batch: the simulations; ``qpos``, ``qvel`` and ``ctrl`` below are live views of it.
        ground: heights of the terrain.
        dt: control step [s].
        action: the last action.
        steps: control steps since each robot started.
    """

    action: Float32[np.ndarray, "robot joint"]
    steps: Int[np.ndarray, " robot"]

    def __init__(
        self,
        robot: LeggedRobot,
        model: mujoco.MjModel,
        size: int,
        scene: LeggedScene = FLAT,
        threads: int = 0,
    ) -> None:
        """Make the simulations; all stand in the default pose at the origin.

        Args:
            robot: the one in the model.
            model: compiled from the robot's description.
            size: number of simulations.
            scene: what the model was described with.
            threads: physics threads; 0 for one per core.
        """
        substeps = 1.0 / (RATE_HZ * model.opt.timestep)
        if abs(substeps - round(substeps)) > 1e-6:
            raise ConfigError(
                f"timestep {model.opt.timestep} s does not divide the control step of "
                f"{1 / RATE_HZ:g} s; {TIMESTEP} does"
            )
        self.robot, self.model, self.size = robot, model, size
        self.batch = Batch(model, size, threads)
        self.ground = GroundHeights(scene.blocks)
        self.dt = 1.0 / RATE_HZ
        self._substeps = round(substeps)
        self._n = len(robot.joints)
        self.q, self.v = robot.addresses(model)
        self._drives = np.array([model.actuator(joint).id for joint in robot.joints])
        self._default = np.array(robot.default)
        self._scale = np.array(robot.action_scale)
        self._free_joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._stand = model.key(STAND).id
        self.batch.reset(keyframe=self._stand)
        self.qpos, self.qvel, self.ctrl = self.batch.qpos, self.batch.qvel, self.batch.ctrl
        self.action = np.zeros((size, self._n), np.float32)
        self.steps = np.zeros(size, int)

    @property
    def time(self) -> Float[np.ndarray, " robot"]:
        """Time since each robot started [s]."""
        return self.steps * self.dt

    @property
    def weight(self) -> float:
        """Weight of one robot with its load [N]."""
        return float(self.model.body_mass.sum() * -self.model.opt.gravity[2])

    @property
    def joint_pos(self) -> Float[np.ndarray, "robot joint"]:
        """Joint positions [rad]."""
        return self.qpos[:, self.q]

    @property
    def joint_vel(self) -> Float[np.ndarray, "robot joint"]:
        """Joint velocities [rad/s]."""
        return self.qvel[:, self.v]

    def reset(
        self, ids: Int[np.ndarray, " restarted"], rng: np.random.Generator, start: Start
    ) -> None:
        """Let some robots start anew, facing anywhere.

        Args:
            ids: indices of these robots.
            rng: of their initial states.
            start: spread of the initial state.
        """
        if not len(ids):
            return
        k, n = len(ids), self._n
        self.batch.reset(ids, keyframe=self._stand, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self.action[ids], self.steps[ids] = 0.0, 0
        at = rng.uniform(-start.area, start.area, (k, 2))
        # as high as the highest ground under or beside the feet
        reach = 0.25 if start.area else 0.0
        corners = ((x, y) for x in (-reach, 0.0, reach) for y in (-reach, 0.0, reach))
        lift = np.zeros(k)
        for x, y in corners:
            np.maximum(lift, self.ground.height(at[:, 0] + x, at[:, 1] + y), out=lift)
        for joint in self._free_joints:  # the trunk's, and that of a ball on its axis
            address = self.model.jnt_qposadr[joint]
            self.qpos[ids, address : address + 2] += at
            self.qpos[ids, address + 2] += lift
        half = 0.5 * rng.uniform(-np.pi, np.pi, k)
        self.qpos[ids, 3], self.qpos[ids, 6] = np.cos(half), np.sin(half)
        self.qpos[ids[:, None], self.q] += rng.uniform(-start.joints, start.joints, (k, n))
        self.qvel[ids, :2] = rng.uniform(-start.speed, start.speed, (k, 2))
        self.qvel[ids, 5] = rng.uniform(-0.5 * start.speed, 0.5 * start.speed, k)

    def step(
        self,
        action: Float[np.ndarray, "robot joint"],
        watch: Callable[[], None] | None = None,
    ) -> None:
        """One control step of all robots.

        Args:
            action: in units of the scale.
            watch: called before every physics step of it.
        """
        self.action[:] = action
        self.ctrl[:, self._drives] = self._default + self._scale * self.action
        if watch is None:
            self.batch.step(nstep=self._substeps)
        else:
            for _ in range(self._substeps):
                watch()
                self.batch.step()
        self.steps += 1

    def observe(self) -> Float32[np.ndarray, "robot obs"]:
        """Readings of the robots' own sensors: :meth:`LeggedRobot.channels`."""
        n = self._n
        out = np.empty((self.size, 6 + 3 * n), np.float32)
        out[:, :3] = self.qvel[:, 3:6]  # MuJoCo's free joint: angular velocity in the body's frame
        out[:, 3:6] = self.gravity()
        out[:, 6 : 6 + n] = self.joint_pos
        out[:, 6 + n : 6 + 2 * n] = self.joint_vel
        out[:, 6 + 2 * n :] = self.action
        return out

    def gravity(self) -> Float[np.ndarray, "robot xyz=3"]:
        """Direction of gravity in the trunk's frame: (0, 0, −1) when upright."""
        w, x, y, z = self.qpos[:, 3:7].T
        # −(third row of the rotation matrix)
        return np.stack(
            [2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1], axis=1
        )

    def velocity(self) -> Float[np.ndarray, "robot velocity=4"]:
        """Velocity of the trunk as commands mean it (three numbers), and upward.

        Forward and sideways [m/s] in the frame that is turned with the trunk's heading, turning
        rate about the vertical [rad/s], vertical velocity [m/s].
        """
        w, x, y, z = self.qpos[:, 3:7].T
        vx, vy, vz, *omega = self.qvel[:, :6].T
        # heading: the trunk's x axis seen from above
        cos, sin = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
        length = np.sqrt(cos * cos + sin * sin) + 1e-9
        cos, sin = cos / length, sin / length
        gravity = self.gravity().T
        out = np.empty((self.size, 4))
        out[:, 0], out[:, 1] = cos * vx + sin * vy, cos * vy - sin * vx
        out[:, 2] = -(gravity[0] * omega[0] + gravity[1] * omega[1] + gravity[2] * omega[2])
        out[:, 3] = vz
        return out

    def height(self) -> Float[np.ndarray, " robot"]:
        """Height of the trunk over the ground under it [m]."""
        return self.qpos[:, 2] - self.ground.height(self.qpos[:, 0], self.qpos[:, 1])

    def fallen(self) -> Bool[np.ndarray, " robot"]:
        """True where a robot has fallen: tilted or sunk too far."""
        upright = -self.gravity()[:, 2]
        return (upright < np.cos(self.robot.fall_tilt)) | (self.height() < self.robot.fall_height)
