"""The four collections of a task: apart from each other, reused, and told by their content."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.config import DataConfig, load
from wt.data.stored import Streams
from wt.errors import DataError
from wt.types import Pairs, Transitions
from wt.worlds import r5
from wt.worlds.base import World, make
from wt.worlds.collect import Collected, collect, model_hash

SMALL = [
    "world.arms=4", "world.episode_steps=25", "world.threads=1",
    "world.motion.routes=2", "world.motion.route_seconds=2",
]  # fmt: skip
COUNTS = {"sim": 220, "real": 220, "validation": 60, "test": 80}


def settings(folder: Path, seed: int = 3) -> DataConfig:
    return DataConfig(str(folder), COUNTS["sim"], COUNTS["validation"], COUNTS["test"], seed)


@pytest.fixture(scope="module")
def world(root: Path) -> World:
    return make(load(root / "conf" / "r5.yaml", SMALL).world)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def collected(world: World, folder: Path) -> Collected:
    return collect(world, settings(folder))


def starts(data: Transitions | Pairs) -> np.ndarray:
    real = data.real if isinstance(data, Pairs) else data
    return real.o[real.step == 0]


def test_sizes_and_kinds(collected: Collected) -> None:
    assert {what: len(getattr(collected, what)) for what in COUNTS} == COUNTS
    assert isinstance(collected.test, Pairs)
    # 220 in parts of 100: episodes of 25 go on counting from part to part
    np.testing.assert_array_equal(collected.sim.episode, np.arange(220) // 25)


def test_r_may_have_fewer_than_s(world: World, collected: Collected, folder: Path) -> None:
    few = collect(world, replace(settings(folder), real_transitions=120))
    assert len(few.real) == 120
    np.testing.assert_array_equal(few.sim.o, collected.sim.o)


def test_of_more_than_memory_is_to_hold_a_sample_is_read(
    world: World, collected: Collected, folder: Path
) -> None:
    large = collect(world, replace(settings(folder), in_memory=150, real_transitions=120))
    assert large.streams.real is None and large.whole("real") is large.real
    assert large.streams.sim is not None and large.whole("sim") is large.streams.sim
    assert large.streams.in_memory == 150 and len(large.streams.sim) == 220
    np.testing.assert_array_equal(large.sim.o, collected.sim.o[:100])  # of 100, 100 and 20
    assert collected.streams == Streams(None, None, 500_000)
    assert large.digest("sim") == collected.digest("sim"), "of all, however much memory holds"
    assert large.digest("real") != collected.digest("real")
    # the last tenth may be held out, and is in no sample
    most = collect(world, replace(settings(folder), in_memory=219))
    np.testing.assert_array_equal(most.sim.o, collected.sim.o[:198])


def test_no_collection_repeats_another(collected: Collected) -> None:
    """Unpaired domains, and test pairs that were in nobody's training: no common start."""
    all_starts = np.concatenate([starts(getattr(collected, what)) for what in COUNTS])
    distance = np.abs(all_starts[:, None] - all_starts[None]).max(axis=2)
    assert distance[np.triu_indices(len(all_starts), 1)].min() > 1e-4


def test_each_domain_is_its_own(world: World, collected: Collected) -> None:
    """S's transitions are S's, R's are R's: plain MuJoCo with the other model misses them."""
    for domain, other in (("sim", "real"), ("real", "sim")):
        data: Transitions = getattr(collected, domain)
        errors = {
            d: max(np.abs(replay(world.model(d), data, k) - data.s_next[k]).max() for k in (3, 130))  # type: ignore[arg-type]
            for d in (domain, other)
        }
        assert errors[domain] < 2e-5
        assert errors[other] > 1e-3


def replay(model: mujoco.MjModel, data: Transitions, k: int) -> np.ndarray:
    d = mujoco.MjData(model)
    d.qpos[:], d.qvel[:], d.ctrl[:] = data.o[k, :6], data.o[k, 6:12], data.a[k]
    d.body("gripper").xfrc_applied[:3] = data.hidden[k]
    mujoco.mj_step(model, d, 10)
    return np.concatenate([d.qpos, d.qvel])


def test_second_time_reads(
    world: World, folder: Path, collected: Collected, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("collected again")

    monkeypatch.setattr(r5.R5World, "collect", never)
    again = collect(world, settings(folder))
    for what in ("sim", "real"):
        np.testing.assert_array_equal(getattr(again, what).o, getattr(collected, what).o)
    np.testing.assert_array_equal(again.test.sim_next, collected.test.sim_next)


@pytest.mark.parametrize("change", ["world.policy.noise=0.06", "world.real.damping=[1,1,1,1,1,1]"])
def test_changed_world_is_collected_anew(
    root: Path, folder: Path, collected: Collected, change: str
) -> None:
    before = set(folder.iterdir())
    other = make(load(root / "conf" / "r5.yaml", [*SMALL, change]).world)
    changed = collect(other, settings(folder))
    assert len(set(folder.iterdir()) - before) == 4
    assert np.abs(changed.real.s_next - collected.real.s_next).max() > 1e-3


def test_changed_seed_is_collected_anew(world: World, tmp_path: Path, collected: Collected) -> None:
    other = collect(world, settings(tmp_path, seed=4))
    assert np.abs(other.sim.o - collected.sim.o).max() > 1e-2
    manifests = [json.loads(p.read_text()) for p in tmp_path.glob("*/manifest.json")]
    assert {m["what"] for m in manifests} == set(COUNTS)
    models = {domain: model_hash(world.model(domain)) for domain in ("sim", "real")}  # type: ignore[arg-type]
    assert all(m["models"] == models for m in manifests)
    assert models["sim"] != models["real"]


def test_report_reaches_every_count(world: World, tmp_path: Path) -> None:
    seen: dict[str, list[int]] = {}
    totals = {}

    def report(what: str, done: int, total: int) -> None:
        seen.setdefault(what, []).append(done)
        totals[what] = total

    collect(world, settings(tmp_path), report)
    for what in ("sim", "real"):
        assert seen[what] == sorted(seen[what])
        assert seen[what][-1] == totals[what] == COUNTS[what]


def test_collections_swapped_on_disk(world: World, tmp_path: Path) -> None:
    collect(world, settings(tmp_path))
    (pairs,) = tmp_path.glob("*-test-*")
    (plain,) = tmp_path.glob("*-sim-*")
    part = "part-000.parquet"
    (pairs / part).write_bytes((plain / part).read_bytes())
    with pytest.raises(DataError, match="where pairs belong") as caught:
        collect(world, settings(tmp_path))
    assert "\n" not in str(caught.value)


def test_model_hash_is_the_same_in_another_process(root: Path, world: World) -> None:
    """Else nothing would ever be reused: no padding or address may enter it."""
    code = (
        "from wt.config import load; from wt.worlds.base import make\n"
        "from wt.worlds.collect import model_hash\n"
        f"w = make(load('conf/r5.yaml', {SMALL!r}).world)\n"
        "print(model_hash(w.model('sim')), model_hash(w.model('real')))"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    assert out.stdout.split() == [model_hash(world.model("sim")), model_hash(world.model("real"))]


def test_model_hash_sees_one_number(world: World) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><option timestep='.01'/></mujoco>")
    before = model_hash(model)
    model.opt.timestep = 0.0100001
    assert model_hash(model) != before


def test_pairs_to_select_by_are_collected_only_where_they_are_needed(
    world: World, tmp_path: Path
) -> None:
    reported: set[str] = set()
    found = collect(
        world, settings(tmp_path), lambda what, *_: reported.add(what), validation=False
    )
    assert found.validation is None and set(found.folders) == {"sim", "real", "test"}
    assert "validation" not in reported and not list(tmp_path.glob("*validation*"))
