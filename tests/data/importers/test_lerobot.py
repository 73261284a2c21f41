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


ARM = {"pan": (1047, 3047), "lift": (47, 4047), "gripper": (2000, 3000)}  # counts


def calibrated(folder: Path, version: str, values: list[float]) -> Path:
    """A dataset of one posture an episode in LeRobot's layout of a version, with a calibration."""
    (folder / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    names = {f"{name}.pos": i for i, name in enumerate(ARM)}  # v3 may have name: index
    features = {f: {"dtype": "float32", "names": names} for f in ("action", "observation.state")}
    info = {"codebase_version": version, "fps": 30, "total_episodes": 4, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    tables = {e: table(e) for e in range(4)}
    for e, rows in tables.items():
        posture = [[x + e for x in values]] * len(rows)
        for column in ("action", "observation.state"):
            i = rows.column_names.index(column)
            rows = rows.set_column(i, column, pa.array(posture))
        tables[e] = rows
    data = folder / "data" / "chunk-000"
    if version == "v3.0":
        pq.write_table(pa.concat_tables([tables[0], tables[1]]), data / "file-000.parquet")
        pq.write_table(pa.concat_tables([tables[2], tables[3]]), data / "file-001.parquet")
        place = {"data/chunk_index": [0] * 4, "data/file_index": [0, 0, 1, 1]}
        index = pa.table({"episode_index": [0, 1, 2, 3], **place})
        pq.write_table(index, folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    else:
        for e, rows in tables.items():
            pq.write_table(rows, data / f"episode_{e:06d}.parquet")
    robot = folder / "calibration" / "robots" / "so101_follower"
    robot.mkdir(parents=True)
    motors = {
        name: {"id": 1, "drive_mode": 0, "homing_offset": 7, "range_min": low, "range_max": high}
        for name, (low, high) in ARM.items()
    }
    (robot / "mine.json").write_text(json.dumps(motors))
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_percent_with_the_datasets_calibration(version: str, tmp_path: Path) -> None:
    folder = calibrated(tmp_path, version, [47.0, -97.0, 17.0])
    # only the file that holds the episode is read
    other = "file-000.parquet" if version == "v3.0" else "episode_000001.parquet"
    (folder / "data" / "chunk-000" / other).write_bytes(b"not read")
    r = base.read(folder, {"episode": 3})
    turn = 2.0 * np.pi / 4095.0
    # 50 of 100 of half of 2000 counts, -94 of half of 4000; the gripper's 20 of 100 from its end
    assert r.columns["qpos/pan"][0] == pytest.approx(0.50 * 1000 * turn)
    assert r.columns["ctrl/lift"][0] == pytest.approx(-0.94 * 2000 * turn)
    assert r.columns["qpos/gripper"][0] == pytest.approx(0.20 * 1000 * turn)
    assert "percent" in str(r.meta["assumed"])
    degrees = base.read(folder, {"episode": 3, "unit": "degrees"})
    assert degrees.columns["qpos/pan"][0] == pytest.approx(np.deg2rad(50.0))
    assert base.read(folder, {"episode": 3, "calibration": False}).columns["qpos/pan"][0] == 50.0


def test_degrees_are_told_by_their_values(tmp_path: Path) -> None:
    r = base.read(calibrated(tmp_path, "v3.0", [120.0, 3.0, 50.0]), {"episode": 0})
    assert r.columns["qpos/lift"][0] == pytest.approx(np.deg2rad(3.0))
    assert r.columns["qpos/gripper"][0] == pytest.approx(0.5 * 1000 * 2.0 * np.pi / 4095.0)
    assert "degrees" in str(r.meta["assumed"])


def test_calibrations_and_versions_that_do_not_fit(tmp_path: Path) -> None:
    folder = calibrated(tmp_path, "v2.1", [1.0, 2.0, 3.0])
    with pytest.raises(DataError, match=r"4 episodes, 0 to 3"):
        base.read(folder)
    for mapping, said in (
        ({"calibration": "none.json"}, "no file 'none.json'"),
        ({"calibration": "meta/info.json"}, "none of lerobot-calibrate"),
        ({"unit": "turns"}, "percent or degrees"),
        ({"calibration": False, "unit": "percent"}, "needs a calibration"),
    ):
        with pytest.raises(DataError, match=said):
            base.read(folder, {"episode": 0, **mapping})
    robot = folder / "calibration" / "robots" / "so101_follower"
    (robot / "other.json").write_text("{}")
    with pytest.raises(DataError, match="several calibrations"):
        base.read(folder, {"episode": 0})
    (folder / "meta" / "info.json").write_text('{"codebase_version": "v1.6"}')
    with pytest.raises(DataError, match=r"v1\.6; v2\.0 to v3 are read"):
        base.read(folder, {"episode": 0})
