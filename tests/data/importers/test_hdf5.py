"""HDF5: the layouts of ALOHA, robomimic and Isaac Lab, others by a map, and links that lead out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base, hdf5
from wt.errors import DataError, RecordingError

h5py = pytest.importorskip("h5py")
N = 150
Q = np.sin(0.02 * np.arange(N)[:, None] * np.arange(1, 15))


def test_aloha(tmp_path: Path) -> None:
    """What record_sim_episodes.py of ALOHA writes, pictures among it."""
    with h5py.File(tmp_path / "episode_0.hdf5", "w") as root:
        root.attrs["sim"] = True
        observations = root.create_group("observations")
        observations.create_group("images").create_dataset("top", (N, 4, 6, 3), dtype="uint8")
        for name, values in {"qpos": Q, "qvel": np.gradient(Q, 0.02, axis=0)}.items():
            observations.create_dataset(name, data=values)
        root.create_dataset("action", data=Q + 0.01)
    r = base.read(tmp_path / "episode_0.hdf5")
    np.testing.assert_allclose(r.t, 0.02 * np.arange(N))
    np.testing.assert_allclose(r.columns["qpos/left_shoulder"], Q[:, 1])
    np.testing.assert_allclose(r.columns["ctrl/right_gripper"], Q[:, 13] + 0.01)
    assert len(r.columns) == 3 * 14
    assert "50 Hz" in str(r.meta["assumed"])
    slower = base.read(tmp_path / "episode_0.hdf5", {"time": {"rate": 30}})
    assert slower.rate_hz == pytest.approx(30)


def robomimic(path: Path, demos: int = 2, **env: object) -> Path:
    with h5py.File(path, "w") as root:
        data = root.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": "Lift", "type": 1, "env_kwargs": env})
        for k in range(demos):
            demo = data.create_group(f"demo_{k}")
            demo.create_dataset("actions", data=np.zeros((N, 7)))
            demo.create_dataset("obs/robot0_joint_pos", data=Q[:, :7] + k)
            demo.create_dataset("obs/robot0_joint_vel", data=np.gradient(Q[:, :7], 0.05, axis=0))
    return path


def test_robomimic(tmp_path: Path) -> None:
    path = robomimic(tmp_path / "a.hdf5", control_freq=20)
    with pytest.raises(DataError, match=r"2 episodes, 0 to 1.*'episode: N'"):
        base.read(path)
    r = base.read(path, {"episode": 1})
    np.testing.assert_allclose(r.columns["qpos/joint3"], Q[:, 3] + 1)
    assert r.rate_hz == pytest.approx(20.0)
    assert not any(name.startswith("ctrl/") for name in r.columns)
    with pytest.raises(DataError, match=r"7 is not there; there are 0…1"):
        base.read(path, {"episode": 7})
    with pytest.raises(DataError, match=r"how fast.*rate"):
        base.read(robomimic(tmp_path / "b.hdf5", 1))


def test_isaac_lab(tmp_path: Path) -> None:
    """States stand after the step of their row's action: the next row's is in force from there."""
    with h5py.File(tmp_path / "a.hdf5", "w") as root:
        data = root.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": "Isaac-Lift", "type": 2})
        demo = data.create_group("demo_0")
        demo.create_dataset("actions", data=np.zeros((N, 9)), compression="gzip")
        demo.create_dataset("processed_actions", data=Q[:, :9], compression="gzip")
        robot = demo.create_group("states/articulation/robot")
        robot.create_dataset("joint_position", data=Q[:, :9])
        robot.create_dataset("joint_velocity", data=np.gradient(Q[:, :9], 0.02, axis=0))
        robot.create_dataset("root_pose", data=np.zeros((N, 7)))
    r = base.read(tmp_path / "a.hdf5", {"time": {"rate": 50}})
    np.testing.assert_array_equal(r.columns["ctrl/joint2"][:-1], Q[1:, 2])
    assert np.isnan(r.columns["ctrl/joint2"][-1])
    assert len(r.columns) == 27


def test_any_other_by_paths_with_a_second_clock(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as root:
        root["log/us"] = (20_000 * np.arange(N)).astype(np.int64)
        root["log/state"] = Q
        root["imu/ms"] = 10 * np.arange(2 * N) + 3
        root["imu/w"] = np.arange(2.0 * N)
        root["words"] = np.array(["a", "b"], dtype=object)
    imu = {"array": "imu/w", "time": {"array": "imu/ms", "scale": 1e-3}}
    mapping = {
        "time": {"array": "log/us", "scale": 1e-6},
        "columns": {"qpos/a": {"array": "log/state", "index": 1}, "sensor/w/0": imu},
    }
    nearest = {"join": {"sensor/w/0": {"how": "nearest", "tolerance": 0.004}}}
    r = base.read(tmp_path / "a.h5", mapping | nearest)
    np.testing.assert_array_equal(r.columns["sensor/w/0"][:5], [0, 2, 4, 6, 8])
    # between 0.013 s and 0.023 s, 0.3 of the way back
    r = base.read(tmp_path / "a.h5", mapping)
    np.testing.assert_allclose(r.columns["sensor/w/0"][1:4], [1.7, 3.7, 5.7])
    with pytest.raises(DataError, match="has no array 'log/stat'"):
        base.read(tmp_path / "a.h5", mapping | {"columns": {"qpos/a": "log/stat"}})
    with pytest.raises(DataError, match="row of numbers"):
        base.read(tmp_path / "a.h5", mapping | {"columns": {"qpos/a": "words"}})


def test_links_that_lead_out_of_the_file(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.arange(N)
    with h5py.File(tmp_path / "a.h5", "w") as root:
        root["t"] = 0.02 * np.arange(N)
        root["qpos/a"] = h5py.ExternalLink("other.h5", "secret")
    with pytest.raises(DataError, match=r"'qpos/a' is a link into another file, 'other\.h5'"):
        base.read(tmp_path / "a.h5")
    with h5py.File(tmp_path / "b.h5", "w") as root:
        root["t"] = 0.02 * np.arange(N)
        raw = [(str(tmp_path / "other.h5"), 0, 8 * N)]
        root.create_dataset("qpos/a", (N,), dtype="f8", external=raw)
    with pytest.raises(DataError, match="kept in other files"):
        base.read(tmp_path / "b.h5")
    with h5py.File(tmp_path / "c.h5", "w") as root:
        root["t"] = 0.02 * np.arange(N)
        layout = h5py.VirtualLayout((N,), dtype="i8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "secret", (N,))
        root.create_virtual_dataset("qpos/a", layout)
    with pytest.raises(DataError, match="kept in other files"):
        base.read(tmp_path / "c.h5")


def test_broken_and_huge_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hdf5, "_PATIENCE_S", 1)
    path = robomimic(tmp_path / "a.hdf5", control_freq=20)
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(DataError, match="not a whole HDF5 file"):
        base.read(path)
    path.write_bytes(b"no magic at all")
    with pytest.raises(DataError, match="not a whole HDF5 file"):
        base.read(path)
    damaged = robomimic(tmp_path / "heap.hdf5", 1, control_freq=20)
    content = damaged.read_bytes()
    at = content.index(b"GCOL")  # the heap of the words: its first object of no size at all
    damaged.write_bytes(content[: at + 16] + bytes(16) + content[at + 32 :])
    with pytest.raises(DataError):
        base.read(damaged)
    with h5py.File(tmp_path / "b.h5", "w") as root:  # promised, never written: a few kB
        root.create_dataset("t", (10**13,), dtype="f8", chunks=(1000,))
        root["qpos/a"] = np.arange(N)
    assert (tmp_path / "b.h5").stat().st_size < 10**5
    with pytest.raises(RecordingError, match="GiB"):
        base.read(tmp_path / "b.h5")
