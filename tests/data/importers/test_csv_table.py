"""A plain CSV file through a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import _csv, base
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


def read_text(folder: Path, text: str) -> dict[str, np.ndarray]:
    (folder / "table.csv").write_text(text)
    table = _csv.read(folder / "table.csv")
    return {name: _csv.numbers(column) for name, column in table.items()}


def test_figures_are_read_as_loggers_write_them(tmp_path: Path) -> None:
    rows = "".join(f"{k}e-2, +{k}.5 ,{'True' if k % 2 else 'False'},{k}\n" for k in range(101))
    table = read_text(tmp_path, "t, up ,contact,mixed\n" + rows + "1.01,1,True,lost\n")
    np.testing.assert_allclose(table["t"], 0.01 * np.arange(102))
    np.testing.assert_array_equal(table["up"][:3], [0.5, 1.5, 2.5])
    np.testing.assert_array_equal(table["contact"][:3], [0.0, 1.0, 0.0])
    assert table["mixed"][100] == 100.0 and np.isnan(table["mixed"][101])


def test_dates_are_times(tmp_path: Path) -> None:
    for form in ("2026-11-25 23:59:{:06.3f}", "2026-11-25T23:59:{:06.3f}Z"):
        rows = "".join(f"{form.format(0.01 * k)},{k}\n" for k in range(120))
        table = read_text(tmp_path, "t,q\n" + rows)
        np.testing.assert_allclose(table["t"] - table["t"][0], 0.01 * np.arange(120), atol=1e-6)


def test_what_later_rows_hold_is_not_guessed_from_the_first(tmp_path: Path) -> None:
    count = 500_000  # several blocks of whole numbers, then a fraction
    rows = "".join(f"{k},{k}\n" for k in range(count))
    table = read_text(tmp_path, f"t,q\n{rows}{count}.5,1.25\n")
    assert table["t"][-1] == count + 0.5 and table["q"][-1] == 1.25


def test_a_last_line_that_is_cut_off_is_left_out_and_others_are_refused(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{k},{k}" for k in range(120)]
    whole = "t,q,v\n" + "\n".join(rows)
    assert len(read_text(tmp_path, whole + "\n1.20,12")["t"]) == 120
    with pytest.raises(DataError, match="line 122 has 2 values where the header has 3"):
        read_text(tmp_path, whole + "\n1.20,12\n1.21,1,2\n")
    with pytest.raises(DataError, match="line 122 has 4 values where the header has 3"):
        read_text(tmp_path, whole + "\n1.20,12,1,2\n")


def test_columns_of_one_name_are_told_apart(tmp_path: Path) -> None:
    table = read_text(tmp_path, "t,q,q\n0,1,2\n1,3,4\n")
    assert {n: list(x) for n, x in table.items()} == {"t": [0, 1], "q": [1, 3], "q.1": [2, 4]}


@pytest.mark.filterwarnings("error")
def test_bytes_that_are_no_text_are_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_bytes(b"t,q\n0,1\n1\xb5\n2,3\n")
    with pytest.raises(DataError, match="cannot be read as CSV: 'utf-8'"):
        _csv.read(tmp_path / "table.csv")
