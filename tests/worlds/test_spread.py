"""Shards that are made on Ray are those that are made here, each once.

Ray runs in a process of its own, for the reasons that tests/physics/test_ray.py gives.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import FromShared
from tests.physics.test_ray import ran
from tests.worlds.test_collect import SMALL
from wt.config import load
from wt.errors import WorkError
from wt.run.study import check
from wt.worlds.base import World, make

_RAY = """
import sys
from pathlib import Path
import ray
from wt.config import DataConfig, load
from wt.worlds import r5
from wt.worlds.base import make
from wt.worlds.collect import collect
from wt.worlds.spread import spread

folder = Path(sys.argv[1])
section = load("r5", sys.argv[2:]).world
world = make(section)

def settings(where):
    return DataConfig(str(where), transitions=220, validation_pairs=60, test_pairs=80)

def shards(name):
    found = {p.relative_to(folder / name): p for p in (folder / name).rglob("part-*.parquet")}
    return {where: (p.read_bytes(), p.stat().st_mtime_ns) for where, p in found.items()}

reported = []
collect(world, settings(folder / "here"))
here = shards("here")
elsewhere = r5.R5World.collect
del r5.R5World.collect  # nothing is made in this process
with spread("ray", section, world) as maker:
    collect(world, settings(folder / "ray"), lambda *told: reported.append(told), maker=maker)
    first = shards("ray")
    lost = sorted(first)[1]
    (folder / "ray" / lost).unlink()
    collect(world, settings(folder / "ray"), maker=maker)
    second = shards("ray")
assert len(here) == 8 and not ray.is_initialized()
assert {w: content for w, (content, _) in here.items()} == {w: c for w, (c, _) in first.items()}
assert {where for where in second if second[where] != first[where]} == {lost}
assert second[lost][0] == first[lost][0]
assert reported[-1] == ("test", 80, 80) and ("sim", 220, 220) in reported
ray.init = None  # nothing is missing, so nothing is started
with spread("ray", section, world) as maker:
    collect(world, settings(folder / "ray"), maker=maker)
"""


@pytest.mark.long
def test_ray_makes_the_same_shards_each_once(tmp_path: Path) -> None:
    try:
        assert ran(_RAY, str(tmp_path), *SMALL, limit=240.0) == ""
    except (subprocess.TimeoutExpired, AssertionError) as error:
        if "Ray does not start here" in str(error) or isinstance(error, subprocess.TimeoutExpired):
            pytest.skip(f"Ray does not start on this machine: {str(error).strip()[-300:]}")
        raise


def test_without_ray_it_is_refused_before_anything_is_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    said_by = r"collect\.jobs=ray needs the package 'ray', .*'\.\[scale\]'"
    with pytest.raises(WorkError, match=said_by) as said:
        check(load("debug", ["collect.jobs=ray"]))
    assert "\n" not in str(said.value)


def same_when_pickled(world: World, count: int) -> World:
    other: World = pickle.loads(pickle.dumps(world))
    for domain in ("sim", "real"):
        mine, its = (w.collect(domain, count, 5) for w in (world, other))  # type: ignore[arg-type]
        for name in ("o", "a", "s_next", "nominal", "hidden", "episode", "step"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(its, name))
    return other


def test_a_walking_world_brings_its_policy_along() -> None:
    small = ["world.robots=2", "world.episode_steps=10", "world.threads=1"]
    same_when_pickled(make(load("go2_flat", small).world), 20)


def test_an_arm_brings_its_recordings_along(
    from_shared: FromShared, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = from_shared("recordings/so101")
    world = make(load("so101", [f"world.recordings={where}", "world.threads=1"]).world)
    content = pickle.dumps(world)
    monkeypatch.setattr(Path, "is_dir", lambda _: False)
    elsewhere: World = pickle.loads(content)
    np.testing.assert_array_equal(
        elsewhere.collect("real", 50, 5).o, world.collect("real", 50, 5).o
    )
