"""MATLAB files, as scipy writes them: flat variables, tables that lie, and cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from wt.data.importers import base
from wt.errors import DataError

T = 0.01 * np.arange(300)


def test_variables_by_their_names(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"t": T, "q": np.sin(T), "u": T[:, None]})
    mapping = {"columns": {"qpos/a": "q", "ctrl/a": {"array": "u", "scale": 2.0}}}
    r = base.read(tmp_path / "a.mat", mapping)
    np.testing.assert_array_equal(r.t, T)
    np.testing.assert_array_equal(r.columns["qpos/a"], np.sin(T))
    np.testing.assert_array_equal(r.columns["ctrl/a"], 2.0 * T)


def test_cells_and_tables_that_lie(tmp_path: Path) -> None:
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = np.stack([np.sin(T), np.cos(T)]), np.stack([T, 2.0 * T])
    scipy.io.savemat(tmp_path / "a.mat", {"time": T, "Y": cells})
    mapping = {
        "columns": {"qpos/a": {"array": "Y/1", "index": 1}, "qvel/a": {"array": "Y/0", "index": 0}}
    }
    r = base.read(tmp_path / "a.mat", mapping)
    np.testing.assert_array_equal(r.columns["qpos/a"], 2.0 * T)
    np.testing.assert_array_equal(r.columns["qvel/a"], np.sin(T))
    with pytest.raises(DataError, match="no array 'Y'"):
        base.read(tmp_path / "a.mat", {"columns": {"qpos/a": "Y"}})


def test_what_is_no_matlab_file(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"not a file of MATLAB at all, but long enough to be read" * 9)
    with pytest.raises(DataError, match="whole MATLAB file"):
        base.read(tmp_path / "a.mat", {"columns": {"qpos/a": "q"}})


def test_version_7_3_is_hdf5_turned_over(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["t"] = T[None]
        file["q"] = np.stack([np.sin(T), np.cos(T)])  # (2, N) here is (N, 2) in MATLAB
        file.create_group("#refs#")["a"] = np.zeros(3)
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    with (tmp_path / "a.mat").open("r+b") as raw:
        raw.write(head)
    r = base.read(tmp_path / "a.mat", {"columns": {"qpos/a": {"array": "q", "index": 1}}})
    np.testing.assert_allclose(r.columns["qpos/a"], np.cos(T))
    (tmp_path / "b.mat").write_bytes(head + b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(DataError, match="not a whole HDF5 file"):
        base.read(tmp_path / "b.mat")
