"""Left and right exchanged: every sample of a symmetric robot is worth two."""

from __future__ import annotations

import mujoco
import numpy as np
import torch
from jaxtyping import Float, Int
from tensordict import TensorDict

from wt.errors import ConfigError
from wt.worlds.legged import LeggedRobot

_Map = tuple[np.ndarray, np.ndarray]
"""Order and sign of channels: two vectors of one length."""

ACTOR_AND_CRITIC = ("policy", "privileged")
"""Groups of observations."""


class Mirror:
    """Maps observations, privileged observations and actions to their mirror images.

    Each map is a permutation of channels with signs: ``mirrored = x[:, order] · sign``.
    """

    def __init__(
        self,
        robot: LeggedRobot,
        model: mujoco.MjModel,
        device: str | torch.device,
        moved: tuple[str, ...] | None = None,
        has_clock: bool = False,
    ) -> None:
        """Find each joint's and foot's counterpart.

        Args:
            robot: whose joints are named by sides (``left_…``, or legs ``FL``, ``FR``, …).
            model: compiled; says about which axis each joint turns.
            device: of the samples.
            moved: joints that actions are of; None for all.
            has_clock: whether the policy sees a clock, which mirrored is half a period later.

        Raises:
            ConfigError: a joint is moved and its counterpart is not.
        """

        def joints(names: tuple[str, ...]) -> _Map:
            # a hinge across the robot's plane turns alike on both sides, any other the other way
            across = [abs(model.joint(name).axis[1]) > 0.5 for name in names]
            return _partners(names), np.where(across, 1.0, -1.0)

        feet = _partners(robot.feet)
        each, action = joints(robot.joints), _joined([joints(moved or robot.joints)])
        clock = _signs("--" if has_clock else "")
        observation = _joined(
            [_signs("-+-"), _signs("+-+"), each, each, each, _signs("+--"), clock]
        )
        foot = (feet, np.ones(len(feet)))
        privileged = _joined([_signs("+--+"), _signs("+"), foot, foot, foot, foot])
        self.maps = {
            name: (torch.as_tensor(order, device=device), torch.as_tensor(sign, device=device))
            for name, (order, sign) in {
                "policy": observation, "privileged": privileged, "action": action,
            }.items()
        }  # fmt: skip

    def __call__(
        self, name: str, x: Float[torch.Tensor, "sample channel"]
    ) -> Float[torch.Tensor, "sample channel"]:
        """The mirror image of samples of one group, named as in ``maps``."""
        order, sign = self.maps[name]
        return x[:, order] * sign


def augment(
    env: object, obs: TensorDict | None, actions: torch.Tensor | None
) -> tuple[TensorDict | None, torch.Tensor | None]:
    """Samples, then their mirror images; called by rsl_rl's symmetry extension."""
    mirror: Mirror = env.mirror  # type: ignore[attr-defined]
    if obs is not None:
        flipped = {name: mirror(name, obs[name]) for name in ACTOR_AND_CRITIC}
        both = {name: torch.cat([obs[name], x]) for name, x in flipped.items()}
        obs = TensorDict(both, batch_size=[2 * obs.batch_size[0]], device=obs.device)
    if actions is not None:
        actions = torch.cat([actions, mirror("action", actions)])
    return obs, actions


def _partners(names: tuple[str, ...]) -> Int[np.ndarray, " name"]:
    """Index of each name's counterpart on the other side; its own if it is in the middle."""

    def other(name: str) -> str:
        for a, b in (("left", "right"), ("FL", "FR"), ("RL", "RR")):
            for one, two in ((a, b), (b, a)):
                if name.startswith(one):
                    return two + name[len(one) :]
        return name

    for name in names:
        if other(name) not in names:
            raise ConfigError(f"joints: {name} is moved and {other(name)} is not; name both sides")
    return np.array([names.index(other(name)) for name in names])


def _signs(signs: str) -> _Map:
    """Channels that stay where they are, each as it is (+) or the other way round (−)."""
    return np.arange(len(signs)), np.array([1.0 if sign == "+" else -1.0 for sign in signs])


def _joined(parts: list[_Map]) -> _Map:
    starts = np.cumsum([0, *(len(order) for order, _ in parts)])
    order = np.concatenate([start + o for start, (o, _) in zip(starts, parts, strict=False)])
    return order, np.concatenate([sign for _, sign in parts]).astype(np.float32)
