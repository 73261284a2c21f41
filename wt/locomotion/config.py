"""The schema of ``conf/policy_*.yaml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

import omegaconf

from wt.errors import ConfigError, suggest
from wt.schema import check_numbers, parse, read
from wt.worlds.gait import Gait, GaitClock
from wt.worlds.legged import LeggedRobot, LeggedScene, Start
from wt.worlds.legged_model import LeggedPhysics
from wt.worlds.robots import robot_of

Device = Literal["auto", "cpu", "cuda"]


@dataclass
class Commands:
    """The commands that are practised (``commands:``)."""

    forward: float = 1.0  # largest, either way [m/s]
    sideways: float = 0.5  # [m/s]
    turn: float = 1.0  # [rad/s]
    seconds: float = 5.0  # mean time that a command holds
    standing: float = 0.1  # share of zero commands
    single: float = 0.3  # share of commands of one axis alone

    @property
    def largest(self) -> tuple[float, float, float]:
        """Largest command either way, as in :data:`wt.worlds.legged.COMMAND`."""
        return (self.forward, self.sideways, self.turn)


@dataclass
class Episodes:
    """Starts and disturbances of robots (``episodes:``); none of them alters their dynamics."""

    seconds: float = 20.0
    start: Start = field(default_factory=lambda: Start(joints=0.1, speed=0.3))
    push: float = 0.4  # largest sudden change of horizontal velocity [m/s]
    push_seconds: float = 8.0  # mean time between two of them


@dataclass
class Rewards:
    """Weights of the terms of ``wt.locomotion.rewards``, per second, and their constants."""

    track_linear: float = 2.0
    track_turn: float = 1.0
    linear_width: float = 0.5  # [m/s] error at which tracking is worth 1/e
    turn_width: float = 0.5  # [rad/s]
    precise: float = 0.3  # share of tracking that is paid for a quarter of that error
    alive: float = 0.0
    fall: float = 3.0  # once, when it falls
    vertical: float = 1.0
    rolling: float = 0.03
    tilt: float = 1.0
    height: float = 1.0
    torque: float = 1e-4
    power: float = 0.0
    acceleration: float = 1e-7
    action_rate: float = 0.01
    limits: float = 10.0
    bumps: float = 1.0
    slip: float = 0.1
    clearance: float = 0.5
    swing_height: float = 0.06  # [m] wanted of a foot's site over where it rests
    air_time: float = 0.8
    air_seconds: float = 0.3  # [s] wanted in the air
    single_stance: float = 0.0
    stance_seconds: float = 0.4  # [s] on one leg that is rewarded at most
    rhythm: float = 0.0
    load: float = 0.0
    lift: float = 0.0
    flight: float = 0.0
    impact: float = 0.0
    still: float = 0.25
    posture: dict[str, float] = field(default_factory=dict)  # weight by pattern of joint names


@dataclass
class Ppo:
    """rsl_rl's PPO (``ppo:``)."""

    iterations: int = 1500
    steps: int = 24  # control steps of each robot per iteration
    hidden: list[int] = field(default_factory=lambda: [256, 128, 64])
    init_std: float = 0.5
    epochs: int = 5
    mini_batches: int = 4
    learning_rate: float = 1e-3
    desired_kl: float = 0.01
    entropy: float = 0.003
    gamma: float = 0.99
    lam: float = 0.95
    clip: float = 0.2
    symmetry: bool = True  # every sample is also learnt from with left and right exchanged
    warm_up: int = 10  # iterations in which the critic learns alone, if it starts from a policy


@dataclass
class PolicyConfig:
    """The configuration that ``wt-train-policy`` reads."""

    name: str = omegaconf.MISSING
    robot: str = omegaconf.MISSING
    robots: int = 2048
    processes: int = 1
    seed: int = 0
    threads: int = 0
    device: Device = "auto"
    save_every: int = 50
    physics: LeggedPhysics | None = None
    scene: LeggedScene = field(default_factory=LeggedScene)
    gait: Gait | None = None
    joints: list[str] = field(default_factory=lambda: ["*"])  # patterns of those that it moves
    commands: Commands = field(default_factory=Commands)
    episodes: Episodes = field(default_factory=Episodes)
    rewards: Rewards = field(default_factory=Rewards)
    ppo: Ppo = field(default_factory=Ppo)

    def body(self) -> LeggedRobot:
        """The robot that is to walk."""
        return robot_of(self.robot)

    def clock(self, size: int) -> GaitClock:
        """The clocks of ``size`` robots."""
        return (
            GaitClock(self.gait.period, size, self.gait.rests)
            if self.gait
            else GaitClock(None, size)
        )

    def moved(self) -> tuple[str, ...]:
        """The joints that the policy moves, in the robot's order; others keep the default pose.

        Raises:
            ConfigError: a pattern fits no joint.
        """
        names = self.body().joints
        fits = [fitting("joints", pattern, names) for pattern in self.joints]
        return tuple(name for name, *fit in zip(names, *fits, strict=True) if any(fit))


def fitting(key: str, pattern: str, joints: Sequence[str]) -> list[bool]:
    """One boolean a joint: true where a pattern fits its name.

    Args:
        key: where the configuration has it, for the message.
        pattern: as a shell's.
        joints: all names.

    Raises:
        ConfigError: it fits none.
    """
    fits = [fnmatchcase(joint, pattern) for joint in joints]
    if not any(fits):
        raise ConfigError(f"{key} {pattern!r} fits no joint: {suggest(pattern, joints)}")
    return fits


def load(path: str | Path, overrides: Sequence[str] = ()) -> PolicyConfig:
    """Read a configuration, apply overrides, check it.

    Args:
        path: a YAML file.
        overrides: ``key=value`` words.

    Raises:
        ConfigError: file missing, not YAML, an unknown key, a wrong type, impossible values.
    """
    return checked(read(Path(path), overrides))


def checked(tree: Mapping[str, Any]) -> PolicyConfig:
    """A configuration from nested plain values.

    Raises:
        ConfigError: as :func:`load`.
    """
    config = parse(PolicyConfig, tree, "")
    check_numbers(config, _ABOVE_ZERO)
    if not config.moved():
        raise ConfigError("joints is empty; ['*'] moves all joints of the robot")
    for name in ("rhythm", "load", "lift"):
        if getattr(config.rewards, name) and config.gait is None:
            raise ConfigError(f"rewards.{name} needs a rhythm; say gait={{}} or rewards.{name}=0")
    if not config.ppo.hidden or min(config.ppo.hidden) < 1:
        raise ConfigError(f"ppo.hidden {config.ppo.hidden} needs at least one layer of one unit")
    if config.robots % config.processes:
        raise ConfigError(
            f"robots {config.robots} cannot be shared evenly among {config.processes} processes; "
            f"robots={-(-config.robots // config.processes) * config.processes} can"
        )
    for name in ("standing", "single"):
        if getattr(config.commands, name) > 1:
            raise ConfigError(
                f"commands.{name} is {getattr(config.commands, name)}; a share is 1 at most"
            )
    return config


_ABOVE_ZERO = {
    "robots", "processes", "save_every", "seconds", "push_seconds", "linear_width", "turn_width",
    "iterations", "steps", "init_std", "epochs", "mini_batches", "learning_rate", "desired_kl",
    "clip", "forward", "turn",
}  # fmt: skip
"""Numbers of any section that zero makes meaningless; no other may be negative either."""
