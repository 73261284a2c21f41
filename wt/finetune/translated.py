"""S with translated dynamics: every transition is brought to where R would have gone.

At each control step the simulator's transition (o, a, o′) goes through the exported model, and the
simulator then observes of itself what the model says: angular velocity and tilt of the trunk, joint
positions and velocities. What no sensor of the robot tells (where the trunk is, where it heads, its
linear velocity, a ball in a box on its back) is not in the model's state and stays as the simulator
left it; with the alignment ``stance``, height and velocity of the trunk move so that standing feet
stay where they are. With the alignment ``action`` nothing is overwritten: the simulator takes the
action under which it comes nearest to that state by itself.

A model that has learnt from robots that walk lets hardly any fall: with every state overwritten a
policy may forget what keeps it up. Some robots may stay in S as it is, where one falls.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from registry.card import MODEL_FILE, Card
from wt.config import Alignment
from wt.evaluate.correction import correct
from wt.locomotion.config import PolicyConfig
from wt.locomotion.env import Walking, make_herd, make_model
from wt.registered import Registered
from wt.types import TransitionSpec
from wt.worlds.legged import Herd
from wt.worlds.walking.rollout import astray
from wt.worlds.walking.state import WalkingState

Array = np.ndarray

Translate = Callable[[Array, Array, Array], Array]
"""From o (N, n_obs), a (N, n_action) and S's next state to R's, (N, n_state), physical units."""


class Translated(Walking):
    """Velocity tracking under translated dynamics; see the module and :class:`Walking`.

    Its report also has ``astray``: the share of steps whose translation is no state that the robot
    can be in, and in which the simulator's own answer stands.
    """

    def __init__(
        self,
        config: PolicyConfig,
        device: str,
        translate: Translate,
        alignment: Alignment = "state",
        scale: Array | None = None,
        mjcf: str | None = None,
        share: float = 1.0,
    ) -> None:
        """Start all robots.

        Args:
            config: what is trained.
            device: of the tensors.
            translate: the model.
            alignment: whether states are overwritten, with or without standing feet that stay,
                or actions corrected.
            scale: what differences of states are measured in, (n_state,), where actions are.
            mjcf: text of the model that stands in S's place; None for the configuration's.
            share: of the robots whose transitions are translated; the others stay in S.
        """
        self._count = max(1, round(share * config.robots))
        self._translate, self._scale, self._mjcf = translate, scale, mjcf
        super().__init__(config, device)
        self._state = WalkingState(self.herd.robot, self.herd.model)
        self._stays = alignment == "stance"
        self._probe = self._make_herd() if alignment == "action" else None

    def _make_herd(self) -> Herd:
        if self._mjcf is None:
            return super()._make_herd()
        model = make_model(self.cfg, mujoco.MjSpec.from_string(self._mjcf))
        return make_herd(self.cfg, self.cfg.robots, model=model)

    def _move(self, action: Array) -> None:
        """One control step as R would do it."""
        herd, robot = self.herd, self.herd.robot
        n = 6 + 2 * len(robot.joints)
        o = np.hstack([herd.observe()[:, :n], robot.targets(herd.action)]).astype(np.float32)
        before = (herd.qpos.copy(), herd.qvel.copy()) if self._probe else None
        herd.step(action)
        a = robot.targets(herd.action).astype(np.float32)
        answer = herd.observe()[:, :n]
        k, target, hidden = self._count, answer.copy(), self._state.hidden(herd)
        target[:k] = self._translate(o[:k], a[:k], answer[:k])
        ground = herd.ground.height(hidden[:k, 0], hidden[:k, 1])
        lost = astray(robot, target[:k], hidden[:k], ground)
        self.sums["astray"] = self.sums.get("astray", 0.0) + float(lost.mean())
        rows = np.flatnonzero(~lost)
        if self._stays:
            hidden[rows] = self._state.feet.kept(
                answer[rows], target[rows], hidden[rows], herd.ground.height
            )
        if before is None:
            self._state.overwrite(herd, target, hidden, rows)
        else:
            target[:k][lost] = answer[:k][lost]
            self._correct(before, a, target)

    def _correct(self, before: tuple[Array, Array], a: Array, target: Array) -> None:
        """Take the step again, under actions that bring the simulator nearest to the target."""
        herd, probe = self.herd, self._probe
        assert probe is not None and self._scale is not None
        robot, n = herd.robot, target.shape[1]

        def answer(targets: Array) -> Array:
            probe.qpos[:], probe.qvel[:] = before
            probe.step(robot.actions(targets))
            return probe.observe()[:, :n]

        better = correct(answer, a, target, self._scale)
        asked = herd.action.copy()
        herd.qpos[:], herd.qvel[:] = before
        herd.step(robot.actions(better))
        herd.action[:], herd.steps = asked, herd.steps - 1  # one step, and the policy's own action


def translated(
    config: PolicyConfig,
    device: str,
    *,
    folder: Path,
    spec: TransitionSpec,
    alignment: Alignment,
    scale: Array | None,
    mjcf: str | None = None,
    share: float = 1.0,
) -> Translated:
    """The environment with a model that was pulled from the registry.

    Args:
        config: what is trained.
        device: of the tensors.
        folder: of the model and its card.
        spec: layout of the task's transitions.
        alignment: see :class:`Translated`.
        scale: likewise.
        mjcf: likewise.
        share: likewise.

    Raises:
        ModelError: the model is of another task, rate, joint order or layout.
    """
    card = Card.load(folder)
    model = Registered(folder / MODEL_FILE, card, spec, config.threads)
    return Translated(config, device, model.predict, alignment, scale, mjcf, share)
