"""A plain CSV file through a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError

MAP = """
time: {column: stamp_us, scale: 1e-6}
columns:
  ctrl/hip: cmd
  qpos/hip: {column: angle_deg, scale: 0.017453292519943295, offset: 0.5}
meta: {robot: bench}
"""


@pytest.fixture
def source(tmp_path: Path) -> Path:
    rows = [f"{20_000 * k},{0.1 * k:.1f},{90 if k % 2 else ''}" for k in range(150)]
    (tmp_path / "log.csv").write_text("stamp_us,cmd,angle_deg\n" + "\n".join(rows) + "\n")
    (tmp_path / "map.yaml").write_text(MAP)
    return tmp_path / "log.csv"


def test_scales_offsets_and_gaps(source: Path) -> None:
    recording = base.read(source, base.read_map(source.with_name("map.yaml")))
    assert recording.rate_hz == pytest.approx(50.0)
    assert recording.columns["ctrl/hip"][7] == pytest.approx(0.7)
    assert recording.columns["qpos/hip"][1] == pytest.approx(np.pi / 2 + 0.5)
    assert np.isnan(recording.columns["qpos/hip"][2])
    assert recording.meta["robot"] == "bench"


def test_maps_that_do_not_fit(source: Path) -> None:
    with pytest.raises(DataError, match="--map"):
        base.read(source)
    time = {"column": "stamp_us"}
    with pytest.raises(DataError, match=r"'comand'.*did you mean 'cmd'"):
        base.read(source, {"time": time, "columns": {"ctrl/hip": "comand"}})
    with pytest.raises(DataError, match=r"'colums'.*'columns'"):
        base.read(source, {"time": time, "colums": {}})
    with pytest.raises(DataError, match="must be numbers"):
        base.read(source, {"time": time | {"scale": "micro"}, "columns": {"ctrl/hip": "cmd"}})


def test_two_clocks_in_one_table(tmp_path: Path) -> None:
    """The second sensor is half as fast, and its columns end earlier."""
    rows = []
    for k in range(120):
        late = f"{40_000 * k + 5_000},{k}" if k < 60 else ","
        rows.append(f"{0.02 * k:.2f},{np.sin(k):.6f},{late}")
    (tmp_path / "log.csv").write_text("t,q,imu_us,gyro\n" + "\n".join(rows) + "\n")
    gyro = {"column": "gyro", "time": {"column": "imu_us", "scale": 1e-6}}
    mapping = {"time": "t", "columns": {"qpos/a": "q", "sensor/gyro/0": gyro},
               "join": {"sensor/*/*": {"how": "nearest", "tolerance": 0.006}}}  # fmt: skip
    r = base.read(tmp_path / "log.csv", mapping)
    np.testing.assert_array_equal(r.columns["sensor/gyro/0"][:4], [0.0, np.nan, 1.0, np.nan])
    del mapping["join"]
    linear = base.read(tmp_path / "log.csv", mapping).columns["sensor/gyro/0"]
    np.testing.assert_allclose(linear[1:4], [0.375, 0.875, 1.375])
    with pytest.raises(DataError, match="none has one"):
        base.read(tmp_path / "log.csv", {"time": "t", "columns": {"qpos/a": "q"},
                                         "join": {"qpos/a": "held"}})  # fmt: skip
