"""A training begins with a policy's actor, and with a critic that has seen it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from wt.errors import ModelError
from wt.locomotion.calibrate import calibrate
from wt.locomotion.config import PolicyConfig, load
from wt.locomotion.env import Walking
from wt.locomotion.start import of_other_drives, take_over
from wt.locomotion.train import make_runner
from wt.worlds.policy import CARD, GRAPH, SHIPPED, Policy


@pytest.fixture
def training(root: Path) -> PolicyConfig:
    return load(
        root / "conf" / "policy_go2.yaml", ["robots=4", "threads=1", "ppo.steps=4", "device=cpu"]
    )


@pytest.fixture
def base(training: PolicyConfig) -> Policy:
    return Policy.load("go2", training.body())


def test_the_actor_is_the_policy_and_only_the_critic_warms_up(
    training: PolicyConfig, base: Policy
) -> None:
    env = Walking(training, "cpu")
    runner = make_runner(env, training.ppo, "cpu")
    critic = [p.clone() for p in runner.alg.critic.parameters()]
    take_over(runner, base, "go2", warm_up=2)
    rows = env.get_observations()["policy"]
    with torch.inference_mode():
        got = runner.alg.get_policy()(env.get_observations())
    wanted = base.act(rows[:, :42].numpy(), rows[:, 42:45].numpy(), rows[:, 45:].numpy())
    # the normaliser goes on with what it sees, as any training's does
    torch.testing.assert_close(got, torch.from_numpy(wanted), atol=1e-3, rtol=1e-3)
    changed = [
        not torch.equal(a, b) for a, b in zip(critic, runner.alg.critic.parameters(), strict=True)
    ]
    assert all(changed)
    assert all(p.requires_grad for p in runner.alg.actor.parameters())


def test_calibrated_commands_are_taken_over(
    training: PolicyConfig, base: Policy, tmp_path: Path
) -> None:
    shipped = SHIPPED / base.card.name
    for name in (GRAPH, CARD):
        (tmp_path / name).write_bytes((shipped / name).read_bytes())
    calibrate(tmp_path, np.array([1.0, 1.0, 1.3]))
    env = Walking(training, "cpu")
    runner = make_runner(env, training.ppo, "cpu")
    policy = Policy.load(tmp_path, training.body())
    take_over(runner, policy, str(tmp_path), warm_up=0)
    rows = env.get_observations()["policy"]
    assert (rows[:, 44] != 0.0).any()
    with torch.inference_mode():
        got = runner.alg.get_policy()(env.get_observations())
    wanted = policy.act(rows[:, :42].numpy(), rows[:, 42:45].numpy(), rows[:, 45:].numpy())
    torch.testing.assert_close(got, torch.from_numpy(wanted), atol=1e-4, rtol=1e-4)


def test_a_graph_of_another_make_is_refused(
    training: PolicyConfig, base: Policy, tmp_path: Path
) -> None:
    graph = onnx.load(SHIPPED / base.card.name / GRAPH)
    for node in graph.graph.node:
        if node.op_type == "Div":
            node.op_type = "Mul"
    onnx.save(graph, tmp_path / GRAPH)
    runner = make_runner(Walking(training, "cpu"), training.ppo, "cpu")
    with pytest.raises(ModelError, match="no normaliser and MLP"):
        take_over(runner, base, str(tmp_path), warm_up=0)


def test_a_policy_for_other_drives_is_begun_with(root: Path) -> None:
    light = load(root / "conf" / "policy_go2_light.yaml", ["robots=4", "threads=1", "device=cpu"])
    with pytest.raises(ModelError, match="stiffness"):
        Policy.load("go2", light.body(), light.physics)
    runner = make_runner(Walking(light, "cpu"), light.ppo, "cpu")
    take_over(runner, of_other_drives(Path("go2"), light.body()), "go2", warm_up=0)
