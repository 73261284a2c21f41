"""NumPy archives, with names beside the tables, with full names, and through a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError

T = 0.01 * np.arange(300)
TABLE = np.stack([np.sin(T), T], axis=1)


def test_tables_with_names(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=T, qpos=TABLE, ctrl=TABLE[:, :1], joints=["hip", "knee"],
             actuators=["motor"], extra=np.ones((3, 3)))  # fmt: skip
    r = base.read(tmp_path / "a.npz")
    assert list(r.columns) == ["qpos/hip", "qpos/knee", "ctrl/motor"]
    np.testing.assert_array_equal(r.columns["qpos/knee"], T)


def test_full_names(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", **{"t": T, "ctrl/a": T, "sensor/gyro/0": T + 1.0})
    r = base.read(tmp_path / "a.npz")
    np.testing.assert_array_equal(r.columns["sensor/gyro/0"], T + 1.0)


def test_a_map(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", us=np.arange(300) * 10_000, q=TABLE, u=T)
    mapping = {"time": {"array": "us", "scale": 1e-6},
               "columns": {"qpos/a": {"array": "q", "index": 1}, "ctrl/a": "u"}}  # fmt: skip
    r = base.read(tmp_path / "a.npz", mapping)
    np.testing.assert_allclose(r.t, T)
    np.testing.assert_array_equal(r.columns["qpos/a"], T)
    for change, said in (
        ({"array": "q"}, "give 'index'"),
        ({"array": "q", "index": 2}, "0…1"),
        ({"array": "p"}, "no array 'p'"),
        ({"array": "u", "scale": "x"}, "must be a number"),
    ):
        with pytest.raises(DataError, match=said):
            base.read(tmp_path / "a.npz", mapping | {"columns": {"ctrl/a": change}})


def test_broken_archives(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez(file, q=TABLE)
    with pytest.raises(DataError, match=r"time: \{array"):
        base.read(file)
    np.savez(file, t=T, qpos=TABLE)
    with pytest.raises(DataError, match="2 names"):
        base.read(file)
    np.savez(file, t=T, qpos=np.array([{}], dtype=object))
    with pytest.raises(DataError, match="plain arrays"):
        base.read(file)
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(DataError, match="whole archive"):
        base.read(file)


def test_a_motion_of_mjlab(tmp_path: Path) -> None:
    """What csv_to_npz.py of mjlab writes."""
    np.savez(tmp_path / "motion.npz", fps=[50], joint_pos=TABLE, joint_vel=TABLE,
             body_pos_w=np.zeros((300, 4, 3)))  # fmt: skip
    mapping = {"joints": {"joint0": "hip", "joint1": "knee"}, "drop": ["qvel/*"]}
    r = base.read(tmp_path / "motion.npz", mapping)
    assert r.rate_hz == pytest.approx(50.0)
    assert set(r.columns) == {"qpos/hip", "qpos/knee"}
