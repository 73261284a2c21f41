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
