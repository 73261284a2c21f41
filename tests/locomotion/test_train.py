"""``wt-train-policy`` from end to end in seconds, and what it leaves behind."""

from __future__ import annotations

import csv
import hashlib
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from wt.cli.train_policy import main
from wt.errors import ConfigError
from wt.locomotion import evaluate, export
from wt.locomotion.config import PolicyConfig, load
from wt.locomotion.env import Walking
from wt.locomotion.train import CHECKPOINT, LOG, Trained, make_runner, train
from wt.run.track import source
from wt.worlds.policy import GRAPH, Policy
from wt.worlds.robots import G1, GO2

ORIGIN = export.Origin("a test", "walking")
TINY = ["robots=8", "threads=1", "device=cpu", "ppo.iterations=2", "ppo.hidden=[16,8]"]


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluation of a second instead of a minute."""
    for name, seconds in (("SETTLE_SECONDS", 0.2), ("TRACK_SECONDS", 1.0), ("WALK_SECONDS", 1.0)):
        monkeypatch.setattr(evaluate, name, seconds)


@pytest.fixture
def tiny(root: Path) -> PolicyConfig:
    return load(root / "conf" / "policy_go2.yaml", TINY)


@pytest.mark.usefixtures("brief")
def test_the_command_trains_exports_and_resumes(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "go2"
    words = ["--config", str(root / "conf" / "policy_go2.yaml"), "--out", str(out), *TINY]
    assert main([*words, "--watch"]) == 0
    printed = capsys.readouterr().out
    assert "2/2 reward" in printed and "forward +1.0 m/s" in printed
    assert (out / "rollout.rrd").stat().st_size > 10_000
    policy = Policy.load(out, GO2)
    assert policy.card.training["iterations"] == 2
    assert policy.card.training["samples"] == 2 * 24 * 8
    assert policy.card.made_by.startswith("wt-train-policy --config")
    assert (policy.card.task, policy.card.run_path, policy.card.sources) == ("go2", "local", {})
    assert policy.card.commit == source().commit
    checkpoint = hashlib.sha256((out / CHECKPOINT).read_bytes()).hexdigest()
    assert len(policy.card.evaluation["tracking"]) == 6
    assert policy.act(np.zeros((3, 42)), np.zeros((3, 3)), np.zeros((3, 0))).shape == (3, 12)

    assert main(words) == 2
    assert "holds a training: continue it with --resume" in capsys.readouterr().err
    assert main([*words, "ppo.iterations=3", "--resume"]) == 0
    with (out / LOG).open() as file:
        assert [int(row["iteration"]) for row in csv.DictReader(file)] == [1, 2, 3]
    resumed = Policy.load(out, GO2).card
    assert (resumed.training["iterations"], resumed.sources) == (3, {"checkpoint": checkpoint})
    assert resumed.config_hash() != policy.card.config_hash()
    assert main([*words, "ppo.hidden=[16,16]", "--resume"]) == 2
    assert "nets of other sizes" in capsys.readouterr().err


def test_a_resumed_training_goes_on_from_the_same_nets(tiny: PolicyConfig, tmp_path: Path) -> None:
    first = train(tiny, tmp_path)
    again = train(tiny, tmp_path, resume=True)  # nothing is left to do
    assert again.iterations == 2
    rows = torch.randn(5, 45)
    assert torch.equal(export.Actor(first.actor, tiny)(rows), export.Actor(again.actor, tiny)(rows))
    saved = torch.load(tmp_path / CHECKPOINT, weights_only=True)
    runner = make_runner(Walking(tiny, "cpu"), tiny.ppo, "cpu")
    runner.alg.load(saved["rsl_rl"], None, True)
    assert runner.alg.optimizer.state_dict()["state"][0]["step"] == 2 * 5 * 4
    assert runner.alg.get_policy().obs_normalizer.count == 2 * 24 * 8


def test_no_time_leaves_a_policy_all_the_same(tiny: PolicyConfig, tmp_path: Path) -> None:
    trained = train(tiny, tmp_path, seconds=0.0)
    assert trained.iterations == 0
    assert (tmp_path / CHECKPOINT).exists()


def test_another_training_s_nets_can_be_taken_over(tiny: PolicyConfig, tmp_path: Path) -> None:
    first = train(tiny, tmp_path / "a")
    second = train(tiny, tmp_path / "b", start_from=tmp_path / "a" / CHECKPOINT, seconds=0.0)
    rows = torch.randn(5, 45)
    assert torch.equal(
        export.Actor(first.actor, tiny)(rows), export.Actor(second.actor, tiny)(rows)
    )


def test_nothing_to_resume_is_refused(tiny: PolicyConfig, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nothing to continue from"):
        train(tiny, tmp_path, resume=True)


def test_ctrl_c_keeps_what_there_is(tiny: PolicyConfig, tmp_path: Path) -> None:
    def stop(done: int, *_: object) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(tiny, tmp_path, progress=stop)
    assert torch.load(tmp_path / CHECKPOINT, weights_only=True)["iteration"] == 1


def test_the_graph_computes_what_rsl_rl_s_actor_does(tiny: PolicyConfig, tmp_path: Path) -> None:
    env = Walking(tiny, "cpu")
    runner = make_runner(env, tiny.ppo, "cpu")
    for _ in range(3):  # so that the normaliser is no identity
        runner.learn(1)
    actor = runner.get_inference_policy("cpu")
    export.write(Trained(actor, 3, 1.0, 576), tiny, tmp_path, ORIGIN)
    policy = Policy.load(tmp_path, GO2)
    obs = env.get_observations()
    both = obs["policy"].numpy()
    with torch.inference_mode():
        wanted = actor(obs).numpy()
    np.testing.assert_allclose(
        policy.act(both[:, :-3], both[:, -3:], np.zeros((8, 0))), wanted, atol=2e-6
    )
    assert str(tmp_path).encode() not in (tmp_path / GRAPH).read_bytes()
    assert b"site-packages" not in (tmp_path / GRAPH).read_bytes()


def test_a_policy_of_some_joints_and_a_clock_is_exported_whole(root: Path, tmp_path: Path) -> None:
    """The legs' net of the training is the package's policy of the whole robot."""
    config = load(root / "conf" / "policy_g1.yaml", TINY)
    env = Walking(config, "cpu")
    runner = make_runner(env, config.ppo, "cpu")
    runner.learn(1)
    actor = runner.get_inference_policy("cpu")
    card = export.write(Trained(actor, 1, 1.0, 192), config, tmp_path, ORIGIN)
    assert card.clock_period == 0.8 and card.observation[-2:] == ["clock/sin", "clock/cos"]
    policy, obs = Policy.load(tmp_path, G1), env.get_observations()
    assert env.herd.time.min() > 0 and env.num_actions == 12
    seen, clock = env.herd.observe(), obs["policy"][:, -2:].numpy()
    with torch.inference_mode():
        wanted = actor(obs).numpy()
    action = policy.act(seen, env.command, clock)
    np.testing.assert_allclose(action[:, :12], wanted, atol=2e-6)
    assert (action[:, 12:] == 0).all()
    seen[:, 6 + 2 * 29 + 12 :] = 3.0  # a last action of the arms, which it never saw
    np.testing.assert_array_equal(policy.act(seen, env.command, clock), action)


@pytest.mark.usefixtures("brief")
def test_evaluation_knows_a_robot_that_only_stands(tiny: PolicyConfig) -> None:
    figures = evaluate.evaluate(tiny, lambda o, c, t: np.zeros((len(o), 12), np.float32), threads=1)
    assert all(t.error == pytest.approx(1.0, abs=0.1) for t in figures.tracking)
    assert figures.worst_error > 0.9
    assert figures.walk.fallen == 0
    assert figures.walk.duty_factor > 0.95
    assert "forward" in evaluate.table(figures)


def test_without_rsl_rl_training_says_what_to_install(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("wt.locomotion.")]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("rsl_rl", "rsl_rl.env", "rsl_rl.runners"):
        monkeypatch.setitem(sys.modules, name, None)
    config = root / "conf" / "policy_go2.yaml"
    assert main(["--config", str(config), "--out", str(tmp_path / "go2")]) == 1
    assert "pip install '.[rl]'" in capsys.readouterr().err
