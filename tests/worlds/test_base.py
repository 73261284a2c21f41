"""The registry of worlds, and what every world in it keeps to."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wt.worlds
from tests.tasks import CONF, TASKS
from wt.config import load
from wt.errors import ConfigError
from wt.worlds import base


@functools.cache
def world_of(task: str) -> dict[str, Any]:
    """``world`` of a shipped configuration."""
    return load(CONF / f"{task}.yaml").world


@dataclass(frozen=True)
class Options:
    """Of the world below."""

    gain: float = 2.0
    names: tuple[str, ...] = ("a",)


@pytest.fixture
def registry(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, type]]:
    """A registry of this test's own."""
    base.kind_of({"name": "r5"})  # all files are imported by now, and none into this registry only
    worlds = dict(base._WORLDS)
    monkeypatch.setattr(base, "_WORLDS", worlds)
    yield worlds


class Whole:
    """Everything the contract asks for, doing nothing."""

    spec = base.TransitionSpec("toy", 50.0, (), (), 0, ())
    shard = 1
    force_body = note = None
    identity = model = collect = sim_step = answers = pairs = len


def planted(name: str) -> type:
    @base.register(name)
    class Planted(Whole):
        options = Options

        def __init__(self, options: Options) -> None:
            self.given = options

    return Planted


def test_a_registered_world_gets_its_options(registry: dict[str, type]) -> None:
    planted("planted")
    world: Any = base.make({"name": "planted", "gain": 3, "names": ["x", "y"]})
    assert world.given == Options(gain=3.0, names=("x", "y"))
    default: Any = base.make({"name": "planted"})
    assert default.given == Options()


def test_the_section_is_left_as_it_was(registry: dict[str, type]) -> None:
    planted("planted")
    section = {"name": "planted", "gain": 3}
    base.make(section)
    assert section == {"name": "planted", "gain": 3}


def test_a_name_used_twice_is_refused(registry: dict[str, type]) -> None:
    first = planted("planted")
    with pytest.raises(ConfigError, match="'planted' is defined by both"):
        planted("planted")
    assert registry["planted"] is first


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"name": "plantd"}, "'plantd' is not known: did you mean 'planted'"),
        ({}, "world.name '' is not known"),
        ({"name": "planted", "gian": 1}, "unknown key 'world.gian'; did you mean 'gain'"),
        ({"name": "planted", "gain": "much"}, "world.gain: Value 'much'"),
        ({"name": "planted", "names": "a"}, "world.names is 'a'; it needs a list"),
    ],
)
def test_mistakes(registry: dict[str, type], section: dict[str, object], message: str) -> None:
    planted("planted")
    with pytest.raises(ConfigError) as caught:
        base.make(section)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_new_file_is_found_by_itself(
    registry: dict[str, type], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "found_by_itself.py").write_text(
        "from dataclasses import dataclass\n"
        "from wt.worlds.base import register\n"
        "@dataclass(frozen=True)\n"
        "class Options:\n    '''None.'''\n"
        "@register('found')\n"
        "class Found:\n"
        "    options, spec, shard, force_body, note = Options, None, 1, None, None\n"
        "    identity = model = collect = sim_step = answers = pairs = len\n"
        "    def __init__(self, options): pass\n"
    )
    monkeypatch.setattr(wt.worlds, "__path__", [*wt.worlds.__path__, str(tmp_path)])
    assert type(base.make({"name": "found"})).__name__ == "Found"


@pytest.mark.parametrize("name", [task.removesuffix(".yaml") for task in TASKS])
def test_every_shipped_world_keeps_the_contract(name: str) -> None:
    world = base.make(world_of(name))
    assert isinstance(world, base.World)
    assert is_dataclass(type(world).options)  # type: ignore[attr-defined]
    spec = world.spec
    assert 0 < spec.n_state <= spec.n_obs
    assert len({c.name for c in spec.observation}) == spec.n_obs
    assert spec.hidden or (world.note or "").startswith("Nothing is hidden")
    assert all(c.unit for c in (*spec.observation, *spec.action, *spec.hidden))
    assert [spec.observation[i].name for i in spec.pose] == [f"qpos/{j}" for j in spec.joints]
    for domain in ("sim", "real"):
        model = world.model(domain)  # type: ignore[arg-type]
        named = {model.joint(j).name for j in range(model.njnt)}
        assert set(spec.joints) <= named


def test_a_world_with_history_is_the_same_world_with_its_past_in_the_observation() -> None:
    section = {
        **world_of("r5"), "arms": 4, "episode_steps": 25, "threads": 1,
        "motion": {"routes": 2, "route_seconds": 2.0},
    }  # fmt: skip
    plain, remembering = base.make(section), base.make({**section, "history": 3})
    assert isinstance(remembering, base.World)
    assert remembering.identity() != plain.identity()
    assert remembering.spec.n_obs == plain.spec.n_obs + 3 * 2 * 6
    whole, kept = (world.pairs("test", 50, 1) for world in (plain, remembering))
    rows = np.flatnonzero(whole.real.step >= 3)
    n = plain.spec.n_obs
    np.testing.assert_array_equal(kept.real.o[:, :n], whole.real.o[rows])
    np.testing.assert_array_equal(kept.sim_next, whole.sim_next[rows])
    # the last action is an observation of its own here
    np.testing.assert_array_equal(kept.real.o[:, n + 6 : n + 12], kept.real.o[:, n - 6 : n])
    # S answers as it did, whatever was before
    np.testing.assert_allclose(remembering.answers(kept.real), kept.sim_next, atol=1e-5)
    some = kept.real
    answer = remembering.sim_step(some.o, some.a, some.hidden)
    np.testing.assert_array_equal(answer, plain.sim_step(some.o[:, :n], some.a, some.hidden))


@pytest.mark.parametrize("history", [-1, 1.5, "two"])
def test_a_history_that_is_no_number_of_steps_is_refused(history: object) -> None:
    with pytest.raises(ConfigError, match=r"world\.history is .* zero or more"):
        base.make({**world_of("r5"), "history": history})
