"""One NumPy array: a table through a map, and named fields."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError

T = 0.01 * np.arange(300)
MAP = {
    "time": {"array": "data", "index": 0},
    "columns": {"qpos/a": {"array": "data", "index": 2}, "ctrl/a": {"array": "data", "index": 1}},
}


def test_a_table_by_its_columns_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.stack([T, np.sin(T), np.cos(T)], axis=1))
    r = base.read(tmp_path / "a.npy", MAP)
    np.testing.assert_array_equal(r.columns["qpos/a"], np.cos(T))
    with pytest.raises(DataError, match=r"no array t.*but data.*wt import --guess"):
        base.read(tmp_path / "a.npy")


def test_a_table_without_time_at_a_rate(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.stack([np.sin(T), np.cos(T)], axis=1).astype(np.float32))
    mapping = {"time": {"rate": 50}, "columns": {"qpos/a": {"array": "data", "index": 1}}}
    r = base.read(tmp_path / "a.npy", mapping)
    np.testing.assert_allclose(r.t, 0.02 * np.arange(300))
    for rate in (0, "fast", True, -1):
        with pytest.raises(DataError, match="number of Hz"):
            base.read(tmp_path / "a.npy", mapping | {"time": {"rate": rate}})


def test_named_fields(tmp_path: Path) -> None:
    fields = [("t", "f8"), ("qpos/a", "f4"), ("ctrl/a", "f4")]
    rows = np.array(list(zip(T, np.sin(T), np.cos(T), strict=True)), dtype=fields)
    np.save(tmp_path / "a.npy", rows)
    r = base.read(tmp_path / "a.npy")
    np.testing.assert_allclose(r.columns["qpos/a"], np.sin(T), atol=1e-6)


def test_what_is_no_array_of_numbers(tmp_path: Path) -> None:
    file = tmp_path / "a.npy"
    np.save(file, np.array([{"run": "me"}], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match="plain numbers"):
        base.read(file, MAP)
    np.save(file, np.zeros((300, 3)))
    whole = file.read_bytes()
    file.write_bytes(whole[:200])
    with pytest.raises(DataError, match="plain numbers"):
        base.read(file, MAP)
    # a header that promises a petabyte
    huge = whole.replace(b"(300, 3)", b"(3" + 13 * b"0" + b", 3)").replace(11 * b" ", b"", 1)
    assert len(huge) == len(whole)
    file.write_bytes(huge)
    with pytest.raises(DataError, match="plain numbers"):
        base.read(file, MAP)
