"""The policies of the package fit their robots and walk in the scene that they are named after."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from wt.locomotion.config import load
from wt.worlds.legged import TIMESTEP, Herd, Start
from wt.worlds.policy import CARD, GRAPH, SHIPPED, Policy, PolicyCard
from wt.worlds.robots import robot_of

ROBOTS, SECONDS, SETTLED = 16, 6.0, 2.0
NAMES = sorted(folder.name for folder in SHIPPED.iterdir() if folder.is_dir())
MACHINE = re.compile(r"/(root|work|tmp|home|Users|opt)\b|[A-Z]:\\")

FALL_SHARE = {"g1_uneven": 0.15, "g1_light_uneven": 0.1}
"""Share of robots that may fall, where it is not none: blocks that a robot cannot see."""

each_policy = pytest.mark.parametrize("name", NAMES)


def test_the_package_has_policies() -> None:
    assert "go2" in NAMES


@each_policy
def test_the_card_is_of_this_graph_and_of_a_robot_we_have(name: str, root: Path) -> None:
    folder = SHIPPED / name
    assert sorted(p.name for p in folder.iterdir()) == [CARD, GRAPH]
    card = PolicyCard.read(folder / CARD)
    assert card.name == name
    assert card.sha256 == hashlib.sha256((folder / GRAPH).read_bytes()).hexdigest()
    trained = load(root / "conf" / f"policy_{name}.yaml")
    policy = Policy.load(name, robot_of(card.robot), trained.physics)
    assert policy.card == card
    most = FALL_SHARE.get(name, 0.0)
    assert all(tracking["fallen"] <= most for tracking in card.evaluation["tracking"])


@each_policy
def test_nothing_names_a_path_of_the_machine_that_made_it(name: str) -> None:
    text = (SHIPPED / name / CARD).read_text(encoding="utf-8")
    assert not MACHINE.search(text)
    graph = (SHIPPED / name / GRAPH).read_bytes()
    assert b".py" not in graph and b"site-packages" not in graph


@each_policy
def test_it_walks_forward_as_told_and_stays_up(name: str, root: Path) -> None:
    """In the scene of conf/policy_<name>.yaml, on MuJoCo's own account of the distance gone."""
    config = load(root / "conf" / f"policy_{name}.yaml")
    robot, scene = config.body(), config.scene
    policy = Policy.load(name, robot, config.physics)
    model = robot.describe(config.physics or robot.physics, TIMESTEP, scene).compile()
    herd = Herd(robot, model, ROBOTS, scene, threads=1)
    rng = np.random.default_rng(5)
    herd.reset(np.arange(ROBOTS), rng, Start(joints=0.05, area=config.episodes.start.area))
    told = 0.8 * policy.card.command_limits[0]
    command = np.tile(np.float32([told, 0.0, 0.0]), (ROBOTS, 1))
    clock = policy.clock(ROBOTS)
    settled, steps = round(SETTLED / herd.dt), round(SECONDS / herd.dt)
    places, fallen = np.empty((steps, ROBOTS, 2)), np.zeros(ROBOTS, bool)
    forward = np.zeros(ROBOTS)
    for k in range(steps):
        herd.step(policy.act(herd.observe(), command, clock.read(herd.time, command)))
        places[k], forward[:] = herd.qpos[:, :2], forward + herd.velocity()[:, 0] / steps
        fallen |= herd.fallen()
        assert fallen.mean() <= FALL_SHARE.get(name, 0.0), f"fell after {k * herd.dt:.1f} s"
    half_seconds = places[settled :: round(0.5 / herd.dt)]
    gone = np.linalg.norm(np.diff(half_seconds, axis=0), axis=2).sum(0)
    speed = gone / (0.5 * (len(half_seconds) - 1))
    upright = ~fallen
    # along where it looks, too: forward is not sideways
    if config.scene.blocks is None:
        np.testing.assert_allclose(speed, told, rtol=0.2)
        assert (forward > 0.5 * told).all()
    else:  # a block may hold one up for seconds
        np.testing.assert_allclose(speed[upright].mean(), told, rtol=0.2)
        assert forward[upright].mean() > 0.6 * told and (forward[upright] > 0).all()
