"""Under a known translation robots are where it says, and hidden things where S left them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from tests.finetune.conftest import MakeModel
from tests.toy_models import carrying, exported
from wt.config import Alignment
from wt.errors import ModelError
from wt.evaluate.multi_step import Now, of_model, roll_out
from wt.finetune.setting import Setting
from wt.finetune.training import environment
from wt.finetune.translated import TranslatedWalking, translated
from wt.locomotion.env import Walking
from wt.worlds.walking.state import WalkingState

Array = np.ndarray
Moves = Callable[[Array, Array, Array], Array]
Shifts = Callable[[Array, Array, Array, Array], Array]

N = 30  # gyro, gravity, joint positions and velocities
ACTIONS = torch.linspace(-0.3, 0.3, 48).reshape(4, 12)


def environments(
    setting: Setting, translate: Moves, shift: Shifts | None = None, **words: object
) -> tuple[Walking, TranslatedWalking]:
    """The simulator as it is and translated, from the same starts, some steps into a walk."""

    def both_of(o: Array, a: Array, s: Array, before: Array) -> tuple[Array, Array | None]:
        return translate(o, a, s), shift(o, a, s, before) if shift else None

    training = setting.training("translation", 0)
    both = Walking(training, "cpu"), TranslatedWalking(training, "cpu", both_of, **words)
    for herd in (one.herd for one in both):
        rng = np.random.default_rng(1)
        for _ in range(10):
            herd.step(0.2 * rng.normal(size=(4, 12)))
    return both


def hidden(env: Walking) -> Array:
    return WalkingState(env.herd.robot, env.herd.model).hidden(env.herd)


def test_the_task_s_state_is_what_a_robot_can_observe_of_itself(setting: Setting) -> None:
    """Linear velocity and ball are hidden, so that nothing can overwrite them."""
    spec = setting.world().spec
    names = [channel.name for channel in spec.state]
    assert [name.split("/")[0] for name in names] == (
        ["gyro"] * 3 + ["gravity"] * 3 + ["qpos"] * 12 + ["qvel"] * 12
    )
    assert {c.name.split("/")[0] for c in spec.hidden} == {
        "position", "heading", "velocity", "ball",
    }  # fmt: skip


def test_translation_overwrites_what_is_observed_and_nothing_else(setting: Setting) -> None:
    shift = np.concatenate([np.full(3, 0.2), np.zeros(3), np.full(12, 0.01), np.full(12, -0.3)])
    raw, moved = environments(setting, lambda o, a, s: s + shift.astype(np.float32))
    raw.herd.step(ACTIONS.numpy())
    moved.step(ACTIONS)
    seen, wanted = moved.herd.observe(), raw.herd.observe()
    np.testing.assert_allclose(seen[:, :N], wanted[:, :N] + shift, atol=2e-5)
    np.testing.assert_allclose(seen[:, N:], ACTIONS, atol=1e-6)
    np.testing.assert_allclose(hidden(moved), hidden(raw), atol=1e-6)
    assert np.abs(hidden(moved)[:, 10:]).max() > 1e-3  # a ball that moves
    np.testing.assert_allclose(moved.get_observations()["policy"][:, :N], seen[:, :N])


def test_a_tilt_that_is_translated_turns_the_trunk_and_takes_the_ball_along(
    setting: Setting,
) -> None:
    turn = np.array([[np.cos(0.1), 0, np.sin(0.1)], [0, 1, 0], [-np.sin(0.1), 0, np.cos(0.1)]])

    def translate(o: Array, a: Array, s: Array) -> Array:
        out = s.copy()
        out[:, 3:6] = s[:, 3:6] @ turn.T
        return out

    raw, moved = environments(setting, translate)
    raw.herd.step(ACTIONS.numpy())
    moved.step(ACTIONS)
    np.testing.assert_allclose(moved.herd.gravity(), raw.herd.gravity() @ turn.T, atol=1e-5)
    np.testing.assert_allclose(hidden(moved), hidden(raw), atol=1e-6)


def test_the_model_is_asked_about_the_transition_as_it_was_trained(setting: Setting) -> None:
    """o ends with the last targets, a are this step's, and S's answer is its own."""
    asked = []

    def translate(o: Array, a: Array, s: Array) -> Array:
        asked.append((o, a, s))
        return s

    raw, moved = environments(setting, translate)
    before, targets = raw.herd.observe(), raw.herd.robot.targets(raw.herd.action)
    raw.herd.step(ACTIONS.numpy())
    moved.step(ACTIONS)
    o, a, s = asked[0]
    np.testing.assert_array_equal(o[:, :N], before[:, :N])
    np.testing.assert_allclose(o[:, N:], targets, atol=1e-6)
    np.testing.assert_allclose(a, raw.herd.robot.targets(ACTIONS.numpy()), atol=1e-6)
    np.testing.assert_array_equal(s, raw.herd.observe()[:, :N])


def test_what_no_robot_can_be_in_is_not_written(setting: Setting) -> None:
    def translate(o: Array, a: Array, s: Array) -> Array:
        out = s.copy()
        out[0], out[1, 0] = np.nan, 1e6
        return out

    raw, moved = environments(setting, translate)
    raw.herd.step(ACTIONS.numpy())
    moved.step(ACTIONS)
    np.testing.assert_allclose(moved.herd.observe(), raw.herd.observe(), atol=2e-5)
    assert moved.report()["astray"] == pytest.approx(0.5)


def test_a_corrected_action_brings_the_simulator_itself_to_the_target(setting: Setting) -> None:
    """The target is where S goes under another action: nothing is overwritten to get near."""
    other = ACTIONS.numpy() + 0.1
    target, _ = environments(setting, lambda o, a, s: s)
    target.herd.step(other)
    wanted = target.herd.observe()[:, :N]
    scale = np.concatenate([np.ones(3), np.full(3, 0.1), np.full(12, 0.1), np.full(12, 2.0)])
    raw, moved = environments(setting, lambda o, a, s: wanted, alignment="action", scale=scale)
    raw.herd.step(ACTIONS.numpy())
    moved.step(ACTIONS)
    far, near = (
        np.abs((env.herd.observe()[:, :N] - wanted) / scale).mean() for env in (raw, moved)
    )
    assert near < 0.5 * far
    np.testing.assert_allclose(moved.herd.action, ACTIONS, atol=1e-6)  # what the policy asked for
    np.testing.assert_array_equal(moved.herd.steps, raw.herd.steps)


def test_standing_feet_stay_where_joints_are_overwritten(setting: Setting) -> None:
    def translate(o: Array, a: Array, s: Array) -> Array:
        out = s.copy()
        out[:, 6:18] += 0.02
        return out

    raw, moved = environments(setting, translate)
    _, stays = environments(setting, translate, alignment="stance")
    raw.herd.step(ACTIONS.numpy())
    for env in (moved, stays):
        env.step(ACTIONS)
    np.testing.assert_allclose(stays.herd.joint_pos, moved.herd.joint_pos, atol=2e-6)
    np.testing.assert_array_equal(moved.herd.qpos[:, 2], raw.herd.qpos[:, 2])
    feet = [raw.herd.model.site(name).id for name in raw.herd.robot.feet]

    def lowest(env: Walking) -> Array:
        data, found = mujoco.MjData(env.herd.model), []
        for row in env.herd.qpos:
            data.qpos[:] = row
            mujoco.mj_kinematics(env.herd.model, data)
            found.append(data.site_xpos[feet, 2].min())
        return np.array(found)

    sunk, kept = (np.abs(lowest(env) - lowest(raw)).mean() for env in (moved, stays))
    assert kept < 0.5 * sunk


@pytest.mark.parametrize("alignment", ["state", "stance"])
def test_torques_and_feet_are_measured_where_the_robots_are(
    setting: Setting, alignment: str
) -> None:
    shift = np.concatenate([np.zeros(18), np.full(12, -0.3)]).astype(np.float32)
    _, moved = environments(setting, lambda o, a, s: s + shift, alignment=alignment)
    moved.step(ACTIONS)
    herd, data = moved.herd, mujoco.MjData(moved.herd.model)
    torque = herd.batch.bind("actuator_force")
    for row in range(herd.size):
        data.qpos[:], data.qvel[:] = herd.qpos[row], herd.qvel[row]
        data.ctrl[:] = herd.ctrl[row]
        mujoco.mj_forward(herd.model, data)
        np.testing.assert_allclose(torque[row], data.actuator_force, rtol=1e-6, atol=1e-6)
        foot = herd.model.sensor(f"feet/{herd.robot.feet[0]}/mjSENS_FRAMEPOS")
        sensed = herd.batch.bind("sensordata")[row, foot.adr[0] : foot.adr[0] + 3]
        np.testing.assert_allclose(
            sensed, data.sensordata[foot.adr[0] : foot.adr[0] + 3], atol=1e-6
        )


def test_a_pulled_model_is_what_runs(setting: Setting, make_model: MakeModel) -> None:
    make = environment(setting, "translation", make_model(shift=0.02))
    make = pickle.loads(pickle.dumps(make))  # as it gets to other processes
    env = make(setting.training("translation", 0), "cpu")
    raw = Walking(setting.training("translation", 0), "cpu")
    raw.herd.step(ACTIONS.numpy())
    env.step(ACTIONS)
    moved = np.array([[0.02], [0.02], [0.02], [0.0]])  # the last quarter of the robots stays in S
    np.testing.assert_allclose(env.herd.joint_pos, raw.herd.joint_pos + moved, atol=2e-5)


def test_stance_is_translation_with_feet_that_stay(setting: Setting, make_model: MakeModel) -> None:
    model, kept = make_model(shift=0.02), {}
    for variant in ("translation", "stance"):
        env = environment(setting, variant, model)(setting.training(variant, 0), "cpu")
        env.step(ACTIONS)
        kept[variant] = env.herd.qpos.copy(), env.herd.joint_pos.copy()
    assert setting.config.alignment == "state"
    np.testing.assert_array_equal(kept["stance"][1], kept["translation"][1])
    # the trunk of those that are translated goes with their feet, that of the last one with S
    apart = np.abs(kept["stance"][0][:, :3] - kept["translation"][0][:, :3]).max(axis=1)
    assert (apart[:3] > 1e-4).all() and apart[3] == 0.0


class Watched:
    """A method of rollouts whose answers are kept."""

    def __init__(self, step: object) -> None:
        self._step, self.states, self.hidden_after, self.moved = step, [], [], 0.0

    def __call__(self, now: Now) -> Array:
        self.states.append(self._step(now))
        return self.states[-1].copy()

    def hidden(self, now: Now, before: Array, after: Array) -> Array:
        self.hidden_after.append(self._step.hidden(now, before, after))
        self.moved = max(self.moved, np.abs(self.hidden_after[-1] - after).max())
        return self.hidden_after[-1].copy()


@pytest.mark.parametrize("alignment", ["state", "stance"])
def test_the_environment_steps_as_the_rollouts_that_judge_a_model(
    setting: Setting, tmp_path: Path, alignment: Alignment
) -> None:
    """Three steps of both, from the same robots of R and under the same actions."""
    world, steps = setting.world(), 3
    model = carrying(world.spec)
    with torch.no_grad():  # a direction of gravity is one in S: what it moves to must be one, too
        for net in model.frame.shift.members:
            net[-1].weight[3:6], net[-1].bias[3:6] = 0.0, 0.0
    truth = world.truth(4, 0, steps, 0)
    rolled = Watched(of_model(model))
    roll_out(world, truth, rolled, np.ones(N), alignment)
    assert rolled.moved > 0.02
    env = translated(
        setting.training("translation", 0), "cpu", folder=exported(tmp_path / "model", model),
        spec=world.spec, alignment=alignment, scale=None,
    )  # fmt: skip
    herd, state = env.herd, WalkingState(env.herd.robot, env.herd.model)
    state.restore(herd, truth.o[:, 0], truth.hidden[:, 0])
    herd.action[:] = herd.robot.actions(truth.o[:, 0, N:])
    o = truth.o[:, 0]
    for k in range(steps):
        a = world.act(o, truth.context[:, k])
        env._move(herd.robot.actions(a))
        o = np.hstack([rolled.states[k], a]).astype(np.float32)
        np.testing.assert_allclose(herd.observe()[:, :N], rolled.states[k], atol=2e-3)
        if alignment == "state":  # stance moves what the rollout carried on, after it
            np.testing.assert_allclose(hidden(env), rolled.hidden_after[k], atol=2e-3)


def test_where_the_simulators_answer_stands_what_is_hidden_is_its_own(setting: Setting) -> None:
    def translate(o: Array, a: Array, s: Array) -> Array:
        out = s.copy()
        out[0] = np.nan
        return out

    def sunk(o: Array, a: Array, s: Array, before: Array) -> Array:
        out = np.zeros_like(before)
        out[:, 4] = 0.1  # forward velocity
        out[1, 2] = -1.0  # below the ground
        return out

    raw, moved = environments(setting, translate, shift=sunk, share=0.75)
    raw.herd.step(ACTIONS.numpy())
    moved.step(ACTIONS)
    change = hidden(moved) - hidden(raw)
    np.testing.assert_allclose(change[:, 4], [0.0, 0.0, 0.1, 0.0], atol=1e-6)
    np.testing.assert_allclose(change[:, 2], 0.0, atol=1e-6)
    assert moved.report()["astray"] == pytest.approx(2 / 3)


def test_a_model_of_another_joint_order_is_refused(setting: Setting, make_model: MakeModel) -> None:
    joints = setting.world().spec.joints
    folder = make_model(joints=(joints[1], joints[0], *joints[2:]))
    with pytest.raises(ModelError, match=r"joint order is FL_thigh_joint at number 0"):
        translated(
            setting.training("translation", 0), "cpu", folder=folder, spec=setting.world().spec,
            alignment="state", scale=None,
        )  # fmt: skip
