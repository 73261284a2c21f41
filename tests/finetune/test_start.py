"""A training begins with the base policy's actor, and with a critic that has seen it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from wt.errors import ModelError
from wt.finetune.setting import Setting
from wt.finetune.start import take_over
from wt.locomotion.calibrate import calibrate
from wt.locomotion.env import Walking
from wt.locomotion.train import make_runner
from wt.worlds.policy import CARD, GRAPH, SHIPPED, Policy


def test_the_actor_is_the_policy_and_only_the_critic_warms_up(setting: Setting) -> None:
    training = setting.training("translation", 0)
    env = Walking(training, "cpu")
    runner = make_runner(env, training.ppo, "cpu")
    critic = [p.clone() for p in runner.alg.critic.parameters()]
    take_over(runner, setting.base, setting.options.policy, warm_up=2)
    rows = env.get_observations()["policy"]
    with torch.inference_mode():
        got = runner.alg.get_policy()(env.get_observations())
    wanted = setting.base.act(rows[:, :42].numpy(), rows[:, 42:45].numpy(), rows[:, 45:].numpy())
    # the normaliser goes on with what it sees, as any training's does
    torch.testing.assert_close(got, torch.from_numpy(wanted), atol=1e-3, rtol=1e-3)
    changed = [
        not torch.equal(a, b) for a, b in zip(critic, runner.alg.critic.parameters(), strict=True)
    ]
    assert all(changed)
    assert all(p.requires_grad for p in runner.alg.actor.parameters())


def test_calibrated_commands_are_taken_over(setting: Setting, tmp_path: Path) -> None:
    shipped = SHIPPED / setting.base.card.name
    for name in (GRAPH, CARD):
        (tmp_path / name).write_bytes((shipped / name).read_bytes())
    calibrate(tmp_path, np.array([1.0, 1.0, 1.3]))
    training = setting.training("translation", 0)
    env = Walking(training, "cpu")
    runner = make_runner(env, training.ppo, "cpu")
    policy = Policy.load(tmp_path, setting.robot, setting.options.sim)
    take_over(runner, policy, str(tmp_path), warm_up=0)
    rows = env.get_observations()["policy"]
    assert (rows[:, 44] != 0.0).any()
    with torch.inference_mode():
        got = runner.alg.get_policy()(env.get_observations())
    wanted = policy.act(rows[:, :42].numpy(), rows[:, 42:45].numpy(), rows[:, 45:].numpy())
    torch.testing.assert_close(got, torch.from_numpy(wanted), atol=1e-4, rtol=1e-4)


def test_a_graph_of_another_make_is_refused(setting: Setting, tmp_path: Path) -> None:
    graph = onnx.load(SHIPPED / setting.base.card.name / GRAPH)
    for node in graph.graph.node:
        if node.op_type == "Div":
            node.op_type = "Mul"
    onnx.save(graph, tmp_path / GRAPH)
    training = setting.training("translation", 0)
    runner = make_runner(Walking(training, "cpu"), training.ppo, "cpu")
    with pytest.raises(ModelError, match="no normaliser and MLP"):
        take_over(runner, setting.base, str(tmp_path), warm_up=0)
