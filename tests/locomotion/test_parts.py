"""An environment in several processes is the same to rsl_rl as one in one piece."""

from __future__ import annotations

import multiprocessing
from pathlib import Path

import pytest
import torch

from wt.errors import ConfigError, WorkError
from wt.locomotion.config import PolicyConfig, load
from wt.locomotion.env import Walking
from wt.locomotion.parts import Parts, environment
from wt.locomotion.train import train

SMALL = ["threads=1", "robots=6", "device=cpu", "ppo.hidden=[16,8]", "ppo.iterations=1"]


def config(root: Path, *more: str) -> PolicyConfig:
    return load(root / "conf" / "policy_go2.yaml", [*SMALL, *more])


def test_one_part_is_the_environment_itself(root: Path) -> None:
    assert isinstance(environment(config(root), "cpu"), Walking)


def test_each_part_does_what_it_does_alone(root: Path) -> None:
    env = environment(config(root, "processes=2", "episodes.push_seconds=0.1"), "cpu")
    assert isinstance(env, Parts)
    alone = [
        Walking(config(root, "robots=3", f"seed={seed}", "episodes.push_seconds=0.1"), "cpu")
        for seed in (0, 1000)
    ]
    actions = torch.randn(6, env.num_actions, generator=torch.Generator().manual_seed(0))
    for _ in range(10):
        obs, reward, done, extras = env.step(actions)
        theirs = [one.step(share) for one, share in zip(alone, actions.split(3), strict=True)]
    for name in ("policy", "privileged"):
        assert torch.equal(obs[name], torch.cat([step[0][name] for step in theirs]))
    assert torch.equal(reward, torch.cat([step[1] for step in theirs]))
    assert done.shape == extras["time_outs"].shape == (6,)
    reports = [one.report() for one in alone]
    mean = sum(report["reward"] for report in reports) / 2
    assert env.report()["reward"] == pytest.approx(mean)


@pytest.mark.long
def test_lengths_of_episodes_are_those_of_the_parts(root: Path) -> None:
    env = environment(config(root, "processes=3"), "cpu")
    env.episode_length_buf[:] = 0
    env.episode_length_buf[4] = int(env.max_episode_length) - 1
    _, _, done, extras = env.step(torch.zeros(6, env.num_actions))
    assert done.tolist() == extras["time_outs"].tolist() == [False] * 4 + [True, False]
    assert env.episode_length_buf.tolist() == [1, 1, 1, 1, 0, 1]


@pytest.mark.long
def test_a_training_in_parts_runs(root: Path, tmp_path: Path) -> None:
    assert train(config(root, "processes=2"), tmp_path).samples == 6 * 24


def test_robots_that_cannot_be_divided_are_refused(root: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"6 cannot be shared evenly among 4 processes.*robots=8 can"
    ):
        config(root, "processes=4")


@pytest.mark.long
def test_a_process_that_ends_is_no_silence(root: Path) -> None:
    env = environment(config(root, "processes=2"), "cpu")
    for process in multiprocessing.active_children():
        process.terminate()
        process.join()
    with pytest.raises(WorkError, match="a process of the training's environment ended"):
        env.step(torch.zeros(6, env.num_actions))
