"""The hidden force on the R5's gripper: a random process per arm, bounded by the arm's state."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Float32

from wt.batch import Batch
from wt.errors import ConfigError
from wt.worlds.r5_model import GRIPPER, JOINTS


@dataclass(frozen=True)
class ForceSettings:
    """The hidden force: a two-state process per arm, held within a control step.

    Attributes:
        max_newton: magnitudes are uniform in 0 … max_newton [N].
        directions: of so many random directions a force takes the first in which the joints bear
            all of it, else that in which they bear the most.
        appear: chance per control step that a force appears [-].
        vanish: chance per control step that it vanishes [-].
        turn: chance per control step that direction and magnitude are drawn anew [-].
        torque_cap: largest torque the force may put on each joint [N·m].
        limit_margin: no force while a joint is nearer than this to its limit [rad].
        speed_cap: no force while a joint is faster than this [rad/s].
    """

    max_newton: float = 200.0
    directions: int = 1
    appear: float = 0.15
    vanish: float = 0.25
    turn: float = 0.1
    torque_cap: tuple[float, ...] = (30.0, 30.0, 30.0, 10.0, 6.0, 3.0)
    limit_margin: float = 0.1
    speed_cap: float = 4.0

    def __post_init__(self) -> None:
        """Refuse what is no chance, no bound or not one value per joint."""
        for name in ("max_newton", "limit_margin", "speed_cap"):
            if not getattr(self, name) >= 0:
                raise ConfigError(
                    f"world.force.{name} is {getattr(self, name)}; it must be zero or more"
                )
        for name in ("appear", "vanish", "turn"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"world.force.{name} is {getattr(self, name)}; 0 … 1 is allowed")
        if self.directions < 1:
            raise ConfigError(f"world.force.directions is {self.directions}; it must be at least 1")
        if self.vanish + self.turn > 1:
            raise ConfigError(
                f"world.force: vanish {self.vanish} and turn {self.turn} exclude each other; "
                "together they may be 1 at most"
            )
        if len(self.torque_cap) != len(JOINTS) or not min(self.torque_cap) >= 0:
            raise ConfigError(
                f"world.force.torque_cap is {tuple(self.torque_cap)}; "
                f"{len(JOINTS)} values of zero or more are needed"
            )


class HiddenForce:
    """The force on many arms at once; writes itself into their batch."""

    def __init__(
        self, settings: ForceSettings, model: mujoco.MjModel, batch: Batch, rng: np.random.Generator
    ) -> None:
        """Start with no force on any arm.

        Args:
            settings: see :class:`ForceSettings`.
            model: the arm's model.
            batch: the arms; positions must be set before the first draw.
            rng: of the process.
        """
        arms = batch.nsim
        self._position = batch.bind("xpos")
        self._settings, self._rng = settings, rng
        self._gripper = model.body(GRIPPER).id
        self._body = np.full(arms, self._gripper, np.int32)
        self._range = model.jnt_range
        self._on = np.zeros(arms, bool)
        self._force = np.zeros((arms, 3))

    def draw(self, batch: Batch) -> Float32[np.ndarray, "arm xyz=3"]:
        """Advance the process one control step and apply it; returns the force [N]."""
        s, rng, n = self._settings, self._rng, len(self._on)
        chance = rng.uniform(size=n)
        appear = ~self._on & (chance < s.appear)
        vanish = self._on & (chance < s.vanish)
        turn = self._on & ~vanish & (chance < s.vanish + s.turn)
        self._on = (self._on | appear) & ~vanish
        fresh = rng.standard_normal((n, s.directions, 3))
        newtons = rng.uniform(0, s.max_newton, (n, 1, 1))
        fresh *= newtons / np.linalg.norm(fresh, axis=-1, keepdims=True)
        q, v = batch.qpos, batch.qvel
        near = (np.abs(v) > s.speed_cap) | (q < self._range[:, 0] + s.limit_margin)
        near |= q > self._range[:, 1] - s.limit_margin
        # after a step positions belong to the state before it: bring them up to date
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        jacobian, _ = batch.jac(self._body, self._position[:, self._gripper])
        best = self._borne(jacobian, fresh).argmax(axis=1)
        fresh = np.take_along_axis(fresh, best[:, None, None], axis=1)
        self._force = np.where((appear | turn)[:, None], fresh[:, 0], self._force)
        scale = self._borne(jacobian, self._force[:, None])[:, 0]
        scale *= self._on & ~near.any(axis=1)
        applied = (self._force * scale[:, None]).astype(np.float32)
        batch.xfrc_applied[:, self._gripper, :3] = applied
        return applied

    def _borne(
        self,
        jacobian: Float[np.ndarray, "arm xyz=3 joint"],
        force: Float[np.ndarray, "arm of xyz=3"],
    ) -> Float[np.ndarray, "arm of"]:
        """Share of each force that loads no joint beyond its cap, 1 at most."""
        torque = np.einsum("nij,nki->nkj", jacobian, force)
        share = np.asarray(self._settings.torque_cap) / np.maximum(np.abs(torque), 1e-9)
        return np.minimum(share.min(axis=-1), 1.0)
