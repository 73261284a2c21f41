from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt.config import load
from wt.errors import ConfigError, ModelError, WorkError
from wt.types import Transitions
from wt.worlds.base import make
from wt.worlds.walking.options import WalkingOptions
from wt.worlds.walking.state import upright
from wt.worlds.walking.world import WalkingWorld

CONF = Path(__file__).resolve().parents[3] / "conf"
SMALL = {"robots": 8, "episode_steps": 50, "threads": 1}


def world(name: str, **changes: object) -> WalkingWorld:
    section: Mapping[str, Any] = {**load(CONF / f"{name}.yaml").world, **SMALL, **changes}
    made = make(section)
    assert isinstance(made, WalkingWorld)
    return made


@pytest.fixture(scope="module", params=["go2_flat", "go2_payload", "g1_flat", "g1_uneven"])
def collected(request: pytest.FixtureRequest) -> tuple[WalkingWorld, Transitions]:
    w = world(request.param)
    return w, w.collect("real", 400, seed=3)


def test_a_transition_holds_all_that_decides_it(
    collected: tuple[WalkingWorld, Transitions],
) -> None:
    """R from R's own observation and hidden variable goes where R went."""
    w, t = collected
    again = w.domain_step("real", t.o, t.a, t.hidden)
    # single precision of the stored state, through stiff contacts
    assert np.quantile(np.abs(again - t.s_next), 0.99) < 1e-4
    assert np.abs(again - t.s_next).max() < 0.05


def test_domains_differ_and_hidden_variables_matter(
    collected: tuple[WalkingWorld, Transitions],
) -> None:
    w, t = collected
    size = t.s_next.std(axis=0)
    gap = np.mean(((w.sim_step(t.o, t.a, t.hidden) - t.s_next) / size) ** 2)
    blind = np.mean(((t.nominal - t.s_next) / size) ** 2)
    assert 1e-4 < gap < blind


def test_what_is_nominal_is_computed_without_the_hidden_variable(
    collected: tuple[WalkingWorld, Transitions],
) -> None:
    w, t = collected
    np.testing.assert_allclose(w.sim_step(t.o, t.a, None), t.nominal, atol=1e-5)


def test_same_seed_same_transitions() -> None:
    w = world("go2_flat")
    one, two, other = (w.collect("sim", 100, seed).o for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert np.abs(one - other).max() > 0.01


def test_steps_follow_each_other(collected: tuple[WalkingWorld, Transitions]) -> None:
    w, t = collected
    n = w.spec.n_state
    inside = np.flatnonzero(np.diff(t.episode) == 0)
    np.testing.assert_array_equal(t.o[inside + 1, :n], t.s_next[inside])
    np.testing.assert_array_equal(t.o[inside + 1, n:], t.a[inside])
    assert (np.diff(t.step)[inside] == 1).all()
    assert (t.step[np.flatnonzero(np.diff(t.episode)) + 1] == 0).all()


def test_upright_against_rotations_of_scipy() -> None:
    rng = np.random.default_rng(0)
    yaw, pitch, roll = rng.uniform([-3, -1, -1], [3, 1, 1], (50, 3)).T
    want = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    gravity = np.einsum("nji,j->ni", want, (0.0, 0.0, -1.0))
    np.testing.assert_allclose(upright(gravity, yaw), want, atol=1e-12)


def test_a_policy_that_falls_is_named() -> None:
    w = world("go2_flat")
    heavy = replace(w._options.real, trunk_mass_scale=8.0)
    with pytest.raises(WorkError, match=r"does not walk in domain real.*wt-train-policy"):
        WalkingWorld(replace(w._options, real=heavy, episode_steps=200)).collect("real", 800, 0)


def test_a_policy_of_another_robot_is_refused() -> None:
    with pytest.raises(ModelError, match="its robot differs"):
        world("go2_flat", robot="g1")


def test_a_missing_policy_is_named() -> None:
    with pytest.raises(ModelError, match="'nobody' does not exist"):
        world("go2_flat", policy="nobody")


@pytest.mark.parametrize(
    ("key", "value"), [("robots", 0), ("command", 1.5), ("noise", -1.0), ("threads", -1)]
)
def test_impossible_options_are_refused(key: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"world.{key}"):
        world("go2_flat", **{key: value})


def test_identity_follows_the_policy_and_not_the_threads() -> None:
    one, two = world("go2_flat"), world("go2_flat", threads=2)
    assert one.identity() == two.identity()
    assert isinstance(one._options, WalkingOptions)
    assert one._policy.identity in one.identity().values()
