"""S with translated dynamics: every transition is brought to where R would have gone.

At each control step the simulator's transition (o, a, o′) goes through the exported model, and the
simulator then observes of itself what the model says: angular velocity and tilt of the trunk, joint
positions and velocities. What no sensor of the robot tells (where the trunk is, where it heads, its
linear velocity, a ball in a box on its back) is not in the model's state. It stays as the simulator
left it, but for what the model says that R's is beyond it (:mod:`wt.nets.hidden_shift`), as in the
rollouts that a model is judged by (:mod:`wt.evaluate.multi_step`); with the alignment ``stance``,
height and velocity of the trunk move so that standing feet stay where they are. With the alignment
``action`` nothing is overwritten: the simulator takes the action under which it comes nearest to
that state by itself.

A model that has learnt from robots that walk lets hardly any fall: with every state overwritten a
policy may forget what keeps it up. Some robots may stay in S as it is, where one falls.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int

from registry.card import MODEL_FILE, Card
from wt.config import Alignment
from wt.evaluate.alignment import align
from wt.locomotion.config import PolicyConfig
from wt.locomotion.env import Walking, make_herd, make_model
from wt.registered import Registered
from wt.types import TransitionSpec
from wt.worlds.legged import Herd
from wt.worlds.walking.rollout import astray
from wt.worlds.walking.state import WalkingState

Translate = Callable[
    [np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray | None]
]
"""From o (N, n_obs), a (N, n_action), S's next state (N, n_state) and its hidden variables before
the step (N, n_hidden) to R's next state, and to what is added to S's hidden variables then; None
for nothing. All in physical units."""


class TranslatedWalking(Walking):
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
        scale: Float[np.ndarray, " state"] | None = None,
        mjcf: str | None = None,
        share: float = 1.0,
    ) -> None:
        """Start all robots.

        Args:
            config: what is trained.
            device: of the tensors.
            translate: the model.
            alignment: how the simulator follows the translation, as in
                :mod:`wt.evaluate.alignment`.
            scale: what differences of states are measured in where actions are corrected.
            mjcf: text of the model that stands in S's place; None for the configuration's.
            share: of the robots whose transitions are translated; the others stay in S.
        """
        self._count = max(1, round(share * config.robots))
        self._translate, self._scale, self._mjcf = translate, scale, mjcf
        super().__init__(config, device)
        self._state = WalkingState(self.herd.robot, self.herd.model)
        self._alignment = alignment
        self._probe = self._make_herd() if alignment == "action" else None

    def _make_herd(self) -> Herd:
        if self._mjcf is None:
            return super()._make_herd()
        model = make_model(self.cfg, mujoco.MjSpec.from_string(self._mjcf))
        return make_herd(self.cfg, self.cfg.robots, model=model)

    def _move(self, action: Float[np.ndarray, "robot joint"]) -> None:
        """One control step as R would do it."""
        herd, robot = self.herd, self.herd.robot
        n = 6 + 2 * len(robot.joints)
        o = np.hstack([herd.observe()[:, :n], robot.targets(herd.action)]).astype(np.float32)
        k, before = self._count, self._state.hidden(herd)
        taken = _HerdStep(herd, self._state, self._probe, action)
        target, hidden = taken.answer.copy(), taken.hidden[:k].copy()
        # translate
        target[:k], shift = self._translate(o[:k], taken.action[:k], taken.answer[:k], before[:k])
        if shift is not None:
            hidden += shift
        # refuse what no robot can be in: the simulator's answer stands there
        ground = herd.ground.height(hidden[:, 0], hidden[:, 1])
        lost = astray(robot, target[:k], hidden, ground)
        self.sums["astray"] = self.sums.get("astray", 0.0) + float(lost.mean())
        target[:k][lost] = taken.answer[:k][lost]
        taken.hidden[:k][~lost] = hidden[~lost]
        taken.rows = np.flatnonzero(~lost)
        align(taken, target, self._alignment, self._scale)


class _HerdStep:
    """One step of a herd, as :func:`wt.evaluate.alignment.align` changes it, in place.

    Attributes:
        action: joint targets under which it was taken, (N, joints) [rad], float32.
        answer: S's state channels after it, (N, n_state).
        hidden: hidden variables after it, (N, n_hidden).
        rows: robots that may be overwritten, (K,).
    """

    def __init__(
        self,
        herd: Herd,
        state: WalkingState,
        probe: Herd | None,
        action: Float[np.ndarray, "robot joint"],
    ) -> None:
        """Let all robots take the step.

        Args:
            herd: the robots.
            state: reads and writes them.
            probe: as many robots on which other actions are tried; None if none will be.
            action: the policy's.
        """
        self._herd, self._state, self._probe = herd, state, probe
        self._before = (herd.qpos.copy(), herd.qvel.copy())
        herd.step(action)
        n = 6 + 2 * len(herd.robot.joints)
        self.action: Float32[np.ndarray, "robot joint"] = herd.robot.targets(herd.action).astype(
            np.float32
        )
        self.answer: Float[np.ndarray, "robot state"] = herd.observe()[:, :n]
        self.hidden: Float[np.ndarray, "robot hidden"] = state.hidden(herd)
        self.rows: Int[np.ndarray, " rows"] = np.arange(len(self.answer))

    def end_state(
        self, action: Float[np.ndarray, "robot joint"]
    ) -> Float[np.ndarray, "robot state"]:
        """As :class:`wt.evaluate.alignment.SimulatorStep`, of joint targets [rad]."""
        probe = self._probe
        assert probe is not None
        probe.qpos[:], probe.qvel[:] = self._before
        probe.step(probe.robot.actions(action))
        return probe.observe()[:, : self.answer.shape[1]]

    def overwrite(self, target: Float[np.ndarray, "robot state"], keep_stance: bool) -> None:
        """As :class:`wt.evaluate.alignment.SimulatorStep`, of the robots in ``rows``."""
        herd, rows = self._herd, self.rows
        if keep_stance:
            self.hidden[rows] = self._state.feet.kept(
                self.answer[rows], target[rows], self.hidden[rows], herd.ground.height
            )
        self._state.overwrite(herd, target, self.hidden, rows)
        if len(rows):
            # torques and the feet's sensors are those of where the robots are, not of S's step
            herd.batch.forward(rows)

    def retake(self, action: Float[np.ndarray, "robot joint"]) -> None:
        """As :class:`wt.evaluate.alignment.SimulatorStep`, of joint targets [rad]."""
        herd, asked = self._herd, self._herd.action.copy()
        herd.qpos[:], herd.qvel[:] = self._before
        herd.step(herd.robot.actions(action))
        herd.action[:], herd.steps = asked, herd.steps - 1  # one step, and the policy's own action


def translated(
    config: PolicyConfig,
    device: str,
    *,
    folder: Path,
    spec: TransitionSpec,
    alignment: Alignment,
    scale: Float[np.ndarray, " state"] | None,
    mjcf: str | None = None,
    share: float = 1.0,
) -> TranslatedWalking:
    """The environment with a model, as it lies in the folder of a run.

    Args:
        config: what is trained.
        device: of the tensors.
        folder: of the model and its card.
        spec: layout of the task's transitions.
        alignment: see :class:`TranslatedWalking`.
        scale: likewise.
        mjcf: likewise.
        share: likewise.

    Raises:
        ModelError: the model is of another task, rate, joint order or layout.
    """
    card = Card.load(folder)
    model = Registered(folder / MODEL_FILE, card, spec, config.threads)
    return TranslatedWalking(config, device, model.step_of, alignment, scale, mjcf, share)
