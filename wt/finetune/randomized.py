"""Domain randomization, the rival: every robot has physics of its own and noisy sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from wt.finetune.config import Randomization
from wt.locomotion.config import PolicyConfig
from wt.locomotion.env import Walking, make_herd, make_model
from wt.worlds.legged import TIMESTEP, Herd
from wt.worlds.legged_model import LeggedPhysics


class Randomized(Walking):
    """Velocity tracking with random physics and noise on observations; see :class:`Walking`."""

    def __init__(
        self, config: PolicyConfig, device: str, ranges: Randomization, timestep: float = TIMESTEP
    ) -> None:
        """Draw every robot's physics and start all.

        Args:
            config: what is trained.
            device: of the tensors.
            ranges: what is drawn.
            timestep: physics step [s].
        """
        self._ranges, self._timestep = ranges, timestep
        self._noise_rng = np.random.default_rng([config.seed, 1])
        n = len(config.body().joints)
        self._width = np.repeat(
            [ranges.gyro_noise, ranges.gravity_noise, ranges.position_noise,
             ranges.velocity_noise, 0.0], [3, 3, n, n, n],
        ).astype(np.float32)  # fmt: skip
        super().__init__(config, device)

    def _make_herd(self) -> Herd:
        config, rng = self.cfg, np.random.default_rng([self.cfg.seed, 2])
        model = make_model(config, timestep=self._timestep)
        herd = make_herd(config, config.robots, model=model)
        physics = config.physics or herd.robot.physics
        trunk = float(herd.model.body(herd.robot.trunk).mass[0])
        drawn = (draw(physics, self._ranges, trunk, rng) for _ in range(herd.size))
        herd.batch.set_models(
            [make_model(replace(config, physics=one), timestep=self._timestep) for one in drawn]
        )
        return herd

    def _observe(self) -> Float32[np.ndarray, "robot obs"]:
        seen = self.herd.observe()
        noise = self._noise_rng.uniform(-1, 1, seen.shape).astype(np.float32)
        return np.asarray(seen + self._width * noise)


def draw(
    physics: LeggedPhysics, ranges: Randomization, trunk: float, rng: np.random.Generator
) -> LeggedPhysics:
    """One robot's physics.

    Args:
        physics: what is varied.
        ranges: how far.
        trunk: mass of its trunk [kg].
        rng: decides.
    """

    def between(low_high: list[float]) -> float:
        return float(rng.uniform(low_high[0], low_high[1]))

    gain = between(ranges.gains)
    return replace(
        physics,
        stiffness=tuple(gain * x for x in physics.stiffness),
        velocity_gain=tuple(gain * x for x in physics.velocity_gain),
        trunk_mass_scale=physics.trunk_mass_scale * (1 + between(ranges.base_mass) / trunk),
        floor_friction=between(ranges.friction),
    )
