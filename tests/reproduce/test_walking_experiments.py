"""The two experiments on figure 3's walking robots: what they order by, and what they move."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wt.config import FitConfig, load
from wt.reproduce.exhibits.influence import influence
from wt.reproduce.exhibits.nearer import world
from wt.types import Pairs
from wt.worlds.base import make

Case = tuple[FitConfig, Pairs, np.ndarray]
CONF = Path(__file__).resolve().parents[2] / "conf"


@pytest.fixture(scope="module", params=["go2_payload.yaml", "go2_flat.yaml"])
def case(request: pytest.FixtureRequest) -> Case:
    """A small world, pairs of it, and the scale of its state."""
    overrides = ["world.robots=8", "world.episode_steps=50", "world.threads=1"]
    config = load(CONF / request.param, overrides)
    pairs = make(config.world).pairs("test", 200, 0)
    return config, pairs, pairs.real.s_next.std(axis=0)


def test_a_simulator_on_its_way_answers_between_s_and_r(case: Case) -> None:
    config, pairs, scale = case
    real = pairs.real

    def error(way: float) -> float:
        answer = world(config, way).sim_step(real.o, real.a, real.hidden)
        return float(np.mean(((answer - real.s_next) / scale) ** 2))

    raw = float(np.mean(((pairs.sim_next - real.s_next) / scale) ** 2))
    assert error(0.0) == pytest.approx(raw, rel=1e-3)
    assert error(0.5) < 0.6 * raw
    assert error(1.0) < 0.01 * raw


def test_influence_is_what_hidden_variables_change_of_the_answer(case: Case) -> None:
    _, pairs, scale = case
    assert (influence(replace(pairs, sim_next=pairs.real.nominal), scale) == 0).all()
    moved = pairs.real.nominal.copy()
    moved[3, 7] += 2 * scale[7]
    found = influence(replace(pairs, sim_next=moved), scale)
    assert found[3] == pytest.approx(4 / len(scale), rel=1e-3)
    assert found.sum() == found[3]
