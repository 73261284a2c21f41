"""The environment that rsl_rl steps: a herd with commands, rewards and automatic restarts.

The actor's group ``policy`` is the observation of :meth:`wt.worlds.legged.Herd.observe`, the
command and, if there is a gait, its clock. The critic also sees ``privileged``: velocity, height,
contacts, clearances and times of the feet. Robots start in slightly different poses and are pushed
now and then: that varies their states, never their dynamics. There is no domain randomization and
no noise on observations.
"""

from __future__ import annotations

import mujoco
import numpy as np
import torch
from jaxtyping import Bool, Float32, Int
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from wt.locomotion import feet
from wt.locomotion.config import Commands, PolicyConfig
from wt.locomotion.mirror import Mirror
from wt.locomotion.rewards import RewardSum, Step
from wt.worlds.legged import TIMESTEP, Herd

_SOFT = 0.9  # share of a joint's range within its soft limits
_CLIP = 20.0  # of actions: what a net that went astray may ask for


def make_herd(
    config: PolicyConfig,
    robots: int,
    threads: int | None = None,
    model: mujoco.MjModel | None = None,
) -> Herd:
    """A herd with sensors at the feet, as the configuration describes it.

    Args:
        config: what is trained.
        robots: their number.
        threads: physics threads instead of the configuration's.
        model: of :func:`make_model`, instead of the configuration's own.
    """
    threads = config.threads if threads is None else threads
    return Herd(config.body(), model or make_model(config), robots, config.scene, threads)


def make_model(
    config: PolicyConfig, spec: mujoco.MjSpec | None = None, timestep: float = TIMESTEP
) -> mujoco.MjModel:
    """The model that a configuration describes, with sensors at the feet.

    Args:
        config: says robot, physics and scene.
        spec: another description of the robot; sensors are added to it.
        timestep: physics step [s]; a description has its own.
    """
    robot = config.body()
    if spec is None:
        spec = robot.describe(config.physics or robot.physics, timestep, config.scene)
    feet.add_sensors(spec, robot)
    return spec.compile()


class Walking(VecEnv):
    """Velocity tracking; see the module and :class:`rsl_rl.env.VecEnv`.

    Attributes:
        herd: the robots.
        command: the velocities that they are to walk at [m/s, m/s, rad/s].
        mirror: for the symmetry extension.
        sums: running sums of what is logged, since :meth:`report`.
    """

    command: Float32[np.ndarray, "robot command=3"]

    def __init__(self, config: PolicyConfig, device: str) -> None:
        """Start all robots.

        Args:
            config: what is trained.
            device: of the tensors; the simulation is on the processor.
        """
        self.cfg, self.device = config, device
        self.herd = herd = self._make_herd()
        model = herd.model
        moved, n = config.moved(), len(herd.robot.joints)
        self.num_envs, self.num_actions = herd.size, len(moved)
        self._moved = np.array([herd.robot.joints.index(name) for name in moved])
        self.max_episode_length = round(config.episodes.seconds / herd.dt)
        self.episode_length_buf = torch.zeros(herd.size, dtype=torch.long)
        self.mirror = Mirror(herd.robot, model, device, moved, config.gait is not None)
        self._rng = np.random.default_rng(config.seed)
        self._reward = RewardSum(config.rewards, herd.robot.joints)
        self._feet, self._clock = feet.FootSensors(herd), config.clock(herd.size)
        self._torque = herd.batch.bind("actuator_force")[:, :n]
        joints = [model.joint(name).id for name in herd.robot.joints]
        low, high = model.jnt_range[joints].T
        middle, half = (low + high) / 2, _SOFT * (high - low) / 2
        self._low, self._high = (x.astype(np.float32) for x in (middle - half, middle + half))
        self._default = np.array(herd.robot.default, np.float32)
        self._weight = herd.weight
        self._last_vel = np.zeros((herd.size, n), np.float32)
        self.command = np.zeros((herd.size, 3), np.float32)
        self.sums: dict[str, float] = {}
        self._steps, self._ended, self._lived = 0, 0, 0
        self._restart(np.arange(herd.size))
        # so that the time-outs of all robots do not come at once
        self.episode_length_buf[:] = torch.from_numpy(
            self._rng.integers(self.max_episode_length, size=herd.size)
        )
        self._velocity = herd.velocity().astype(np.float32)
        self._observation = self._tensors()

    def _make_herd(self) -> Herd:
        """The robots; one of three methods that another environment overrides."""
        return make_herd(self.cfg, self.cfg.robots)

    def _move(self, action: Float32[np.ndarray, "robot joint"]) -> None:
        """One control step of all robots under actions; likewise."""
        self.herd.step(action)

    def _observe(self) -> Float32[np.ndarray, "robot obs"]:
        """The actor's observation of the robots; likewise."""
        return self.herd.observe()

    def get_observations(self) -> TensorDict:
        """The observations as they are now."""
        return self._observation

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """One control step; robots that fall or are out of time start anew."""
        herd = self.herd
        last_action = herd.action.copy()
        action = np.zeros_like(last_action)
        action[:, self._moved] = actions.clamp(-_CLIP, _CLIP).cpu().numpy()
        self._move(action)
        self._feet.update()
        self._velocity = herd.velocity().astype(np.float32)
        fallen = herd.fallen()
        step = self._measure(last_action)
        reward, means = self._reward(step, fallen)
        self._log(step, reward, fallen, means)
        self.episode_length_buf += 1
        late = self.episode_length_buf.numpy() >= self.max_episode_length
        ended = np.flatnonzero(fallen | late)
        time_outs = torch.from_numpy(late & ~fallen).to(self.device)
        self._lived += int(herd.steps[ended].sum())
        self._ended += len(ended)
        self._restart(ended)
        self._disturb()
        self._observation = self._tensors()
        return (
            self._observation,
            torch.from_numpy(reward).to(self.device),
            torch.from_numpy(fallen | late).to(self.device),
            {"time_outs": time_outs},
        )

    def report(self) -> dict[str, float]:
        """Means since the last call, by name.

        ``reward`` is per second; ``episode`` the mean length of the episodes that ended [s];
        ``falls`` per robot and minute; ``error_…`` mean absolute errors of tracking.
        """
        seconds = self._steps * self.herd.dt
        means = {name: total / max(self._steps, 1) for name, total in self.sums.items()}
        means["falls"] *= 60 / self.herd.dt
        means["episode"] = self._lived * self.herd.dt / self._ended if self._ended else seconds
        self.sums = {}
        self._steps, self._ended, self._lived = 0, 0, 0
        return means

    def _measure(self, last_action: Float32[np.ndarray, "robot joint"]) -> Step:
        herd, foot = self.herd, self._feet
        pos, vel = herd.joint_pos.astype(np.float32), herd.joint_vel.astype(np.float32)
        acc = (vel - self._last_vel) / np.float32(herd.dt)
        self._last_vel = vel
        return Step(
            command=self.command,
            moving=self._clock.running,
            velocity=self._velocity,
            gyro=herd.qvel[:, 3:6].astype(np.float32),
            gravity=herd.gravity().astype(np.float32),
            height=(herd.height() - herd.robot.height).astype(np.float32),
            pose=pos - self._default,
            excess=np.maximum(self._low - pos, 0) + np.maximum(pos - self._high, 0),
            joint_vel=vel,
            joint_acc=acc,
            torque=self._torque.astype(np.float32),
            action=herd.action,
            last_action=last_action,
            contact=foot.contact,
            landed=foot.landed,
            others=foot.others,
            force=foot.force / np.float32(self._weight),
            clearance=foot.clearance,
            foot_speed=foot.speed,
            air=foot.air,
            stance=foot.stance,
            swing=self._swing(),
            dt=herd.dt,
        )

    def _swing(self) -> Float32[np.ndarray, "robot foot"]:
        gait, herd = self.cfg.gait, self.herd
        if gait is None:
            return np.full_like(self._feet.clearance, -1.0)
        running = self._clock.running[:, None]
        return np.where(running, gait.swing(herd.time, herd.robot.turns), np.float32(-1.0))

    def _log(
        self,
        step: Step,
        reward: Float32[np.ndarray, " robot"],
        fallen: Bool[np.ndarray, " robot"],
        means: dict[str, float],
    ) -> None:
        error = np.abs(step.velocity[:, :3] - step.command).mean(0)
        values = {
            "reward": float(reward.mean()) / self.herd.dt,
            "falls": float(fallen.mean()),
            "error_forward": float(error[0]),
            "error_sideways": float(error[1]),
            "error_turn": float(error[2]),
            **{f"term_{name}": mean for name, mean in means.items()},
        }
        for name, value in values.items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self._steps += 1

    def _restart(self, ids: Int[np.ndarray, " restarted"]) -> None:
        self.herd.reset(ids, self._rng, self.cfg.episodes.start)
        self.episode_length_buf[ids] = 0
        self._feet.forget(ids)
        self._last_vel[ids] = 0.0
        self.command[ids] = sample_commands(self.cfg.commands, len(ids), self._rng)

    def _disturb(self) -> None:
        """New commands and pushes, each at the same chance in every step."""
        rng, herd = self._rng, self.herd
        new = np.flatnonzero(rng.random(herd.size) < herd.dt / self.cfg.commands.seconds)
        self.command[new] = sample_commands(self.cfg.commands, len(new), rng)
        push = self.cfg.episodes.push
        if push:
            chance = herd.dt / self.cfg.episodes.push_seconds
            pushed = np.flatnonzero(rng.random(herd.size) < chance)
            herd.qvel[pushed, :2] += rng.uniform(-push, push, (len(pushed), 2))

    def _tensors(self) -> TensorDict:
        herd, foot = self.herd, self._feet
        clock = self._clock.read(herd.time, self.command)
        policy = np.concatenate([self._observe(), self.command, clock], axis=1)
        height = (herd.height()[:, None] - herd.robot.height).astype(np.float32)
        privileged = np.concatenate(
            [self._velocity, height, foot.contact, foot.clearance, foot.air, foot.stance],
            axis=1, dtype=np.float32,
        )  # fmt: skip
        groups = {"policy": policy, "privileged": privileged}
        tensors = {name: torch.from_numpy(x).to(self.device) for name, x in groups.items()}
        return TensorDict(tensors, batch_size=[herd.size], device=self.device)


def sample_commands(
    commands: Commands, count: int, rng: np.random.Generator
) -> Float32[np.ndarray, "{count} command=3"]:
    """Commands to practise: uniform, some of one axis alone, some zero."""
    out = rng.uniform(-1, 1, (count, 3)) * commands.largest
    kind = rng.random(count)
    single = kind < commands.single
    axis = rng.integers(3, size=count)
    out[single] *= np.eye(3)[axis[single]]
    out[kind > 1 - commands.standing] = 0.0
    return out.astype(np.float32)
