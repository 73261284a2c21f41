"""LeRobot datasets: one file an episode (v2), several in one file (v3), and broken ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wt.data.importers import base
from wt.errors import DataError

NAMES = ["pan.pos", "pan.vel", "main_jaw"]


def table(*episodes: int) -> pa.Table:
    rows = [
        {
            "observation.state": [1.0 * k, 30.0, 3.0 + e], "action": [k + 0.5, 7.0, 8.0],
            "timestamp": k / 30.0, "frame_index": k, "episode_index": e, "task_index": 0,
        }
        for e in episodes
        for k in range(90)
    ]  # fmt: skip
    return pa.Table.from_pylist(rows)


def write_dataset(folder: Path) -> Path:
    (folder / "meta").mkdir()
    (folder / "data" / "chunk-000").mkdir(parents=True)
    action = [name.replace(".vel", "_2.pos") for name in NAMES]
    features = {"observation.state": {"names": {"motors": NAMES}}, "action": {"names": action}}
    info = {"robot_type": "so101", "fps": 30, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    for e in (0, 1):
        name = f"episode_{e:06d}.parquet"
        pq.write_table(table(e), folder / "data" / "chunk-000" / name)
    return folder


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return write_dataset(tmp_path)


def test_one_episodes_file(dataset: Path) -> None:
    r = base.read(dataset / "data" / "chunk-000" / "episode_000001.parquet")
    assert r.rate_hz == pytest.approx(30.0)
    assert list(r.columns) == [
        "ctrl/pan", "ctrl/pan_2", "ctrl/main_jaw", "qpos/pan", "qvel/pan", "qpos/main_jaw"
    ]  # fmt: skip
    assert (r.columns["ctrl/pan"][2], r.columns["qpos/pan"][2]) == (2.5, 2.0)
    assert r.columns["qpos/main_jaw"][0] == 4.0
    assert (r.meta["robot"], r.meta["episode"]) == ("so101", 1)


def test_a_folder_needs_an_episode(dataset: Path) -> None:
    with pytest.raises(DataError, match=r"2 episodes.*episode: N"):
        base.read(dataset)
    assert base.read(dataset, {"episode": 1}).columns["qpos/main_jaw"][0] == 4.0
    with pytest.raises(DataError, match=r"5 is not there.*0…1"):
        base.read(dataset, {"episode": 5})


def test_units_of_the_map(dataset: Path) -> None:
    r = base.read(dataset, {"episode": 0, "units": "deg"})
    assert r.columns["qpos/pan"][3] == pytest.approx(np.deg2rad(3.0))
    assert r.columns["ctrl/main_jaw"][0] == pytest.approx(np.deg2rad(8.0))


def test_without_names(dataset: Path) -> None:
    (dataset / "meta" / "info.json").write_text("{}")
    r = base.read(dataset, {"episode": 0, "joints": {"joint0": "pan"}})
    assert {"ctrl/pan", "qpos/pan", "qpos/joint2"} <= set(r.columns)


def test_several_episodes_in_one_file(dataset: Path) -> None:
    for file in (dataset / "data").rglob("*.parquet"):
        file.unlink()
    pq.write_table(table(3, 4), dataset / "data" / "chunk-000" / "file-000.parquet")
    r = base.read(dataset, {"episode": 4})
    assert (len(r), r.columns["qpos/main_jaw"][0]) == (90, 7.0)


def test_broken_datasets(dataset: Path) -> None:
    file = dataset / "data" / "chunk-000" / "episode_000001.parquet"
    file.write_bytes(file.read_bytes()[:300])
    for source in (file, dataset):
        with pytest.raises(DataError, match="not whole Parquet"):
            base.read(source)
    (dataset / "meta" / "info.json").write_text('{"fps": ')
    with pytest.raises(DataError, match=r"info\.json"):
        base.read(dataset)
