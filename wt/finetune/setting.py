"""A configuration made concrete: the task's two domains, the base policy, each training."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import mujoco

from wt.config import load as load_task
from wt.errors import ConfigError
from wt.finetune.config import Finetune, Variant
from wt.locomotion.config import PolicyConfig as Training
from wt.locomotion.config import checked
from wt.schema import merge, parse
from wt.types import Domain
from wt.worlds import model_file
from wt.worlds.legged import Herd, LeggedRobot
from wt.worlds.policy import Policy
from wt.worlds.robots import robot_of
from wt.worlds.walking.options import WalkingOptions
from wt.worlds.walking.world import WalkingWorld


@dataclass(frozen=True)
class Setting:
    """A task with its base policy.

    Attributes:
        config: what was asked for.
        options: of the task's world.
        robot: what walks.
        base: the policy that all variants begin with.
        threads: of physics and inference where the configuration says none; 0 for one per core.
    """

    config: Finetune
    options: WalkingOptions
    robot: LeggedRobot
    base: Policy
    threads: int = 0

    @classmethod
    def of(cls, config: Finetune, threads: int = 0) -> Setting:
        """Read the task and load the base policy.

        Args:
            config: what was asked for.
            threads: as the attribute.

        Raises:
            ConfigError: the task cannot be read, or nothing walks in it.
            ModelError: the policy is missing or one of another robot.
        """
        section = dict(load_task(config.task).world)
        if section.pop("name", None) != "walking":
            raise ConfigError(f"task {config.task}: nothing walks there; take go2_payload")
        options = parse(WalkingOptions, section, "world.")
        if config.policy is not None:
            options = replace(options, policy=config.policy)
        robot = robot_of(options.robot)
        base = Policy.load(options.policy, robot, options.sim)
        return cls(config, options, robot, base, threads)

    def world(self, variant: Variant = "none") -> WalkingWorld:
        """The task's world, as a variant has it."""
        return WalkingWorld(self._options(variant))

    def training(self, variant: Variant, seed: int) -> Training:
        """Training of a variant: as the base policy's, with what the configuration changes.

        Raises:
            ConfigError: the configuration's ``training`` holds what a trainer does not know.
        """
        return self._trained_in("sim", f"{self.base.card.name}_{variant}", seed)

    def shown(self) -> Training:
        """The same in R, for a recording."""
        return self._trained_in("real", self.base.card.name, 0)

    def reality(self, robots: int) -> Herd:
        """R, in which policies are evaluated.

        Args:
            robots: how many.
        """
        scene, threads = self.options.scene("real"), self.shown().threads
        return Herd(self.robot, self.world().model("real"), robots, scene, threads)

    def simulator(self, variant: Variant) -> mujoco.MjSpec:
        """S of a variant: the task's, or what stands in its place.

        Raises:
            ModelError: that cannot be read, or is of another robot.
        """
        world, path = self.world(variant), self._options(variant).model
        if path is None:
            return world.description("sim")
        return mujoco.MjSpec.from_file(str(model_file.mjcf(path)))

    def _options(self, variant: Variant) -> WalkingOptions:
        mjcf = self.config.diagnosed.mjcf
        return self.options if variant != "diagnosed" else replace(self.options, model=mjcf)

    def _trained_in(self, domain: Domain, name: str, seed: int) -> Training:
        options = self.options
        physics = options.sim if domain == "sim" else options.real
        tree: dict[str, Any] = merge(self.base.card.config, self.config.training)
        tree |= {"name": name, "seed": seed, "physics": asdict(physics)}
        if tree.get("threads") == 0:
            tree["threads"] = self.threads
        return checked(tree | {"scene": asdict(options.scene(domain))})
