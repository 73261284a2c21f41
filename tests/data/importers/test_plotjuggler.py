"""Exports of PlotJuggler: a row a time, a cell only where something came."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError

HEADER = (
    "__time,/cmd/hip/effort,/cmd/hip/position,/drive[0]/current,/joint_states/hip/effort,"
    "/joint_states/hip/position"
)


def write(path: Path, header: str = HEADER) -> Path:
    """States every 50 ms, commands 20 ms after every second one, a current with each command."""
    rows = []
    for k in range(50):
        t = 1e9 + 0.05 * k
        rows.append(f"{t:.6f},,,,0.500000000,{np.sin(0.05 * k):.9f}")
        if k % 2 == 0:
            rows.append(f"{t + 0.02:.6f},9.000000000,{k:.9f},{0.1 * k:.9f},,")
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_joint_states_by_their_columns_names(tmp_path: Path) -> None:
    r = base.read(write(tmp_path / "a.csv"))
    assert set(r.columns) == {"qpos/hip", "force/hip", "ctrl/hip"}
    np.testing.assert_allclose(r.t, 0.05 * np.arange(50), atol=2e-6)
    np.testing.assert_allclose(r.columns["qpos/hip"], np.sin(r.t), atol=1e-5)
    np.testing.assert_array_equal(r.columns["ctrl/hip"][:5], [np.nan, 0, 0, 2, 2])
    assert r.meta["format"] == "plotjuggler"


def test_other_columns_by_a_map_and_joined_its_way(tmp_path: Path) -> None:
    mapping = {
        "columns": {"sensor/current/0": {"column": "/drive[0]/current", "scale": 10.0}},
        "join": {"sensor/*/*": {"how": "nearest", "tolerance": 0.025}},
    }
    r = base.read(write(tmp_path / "a.csv"), mapping)
    np.testing.assert_allclose(r.columns["sensor/current/0"][:4], [0.0, np.nan, 2.0, np.nan])
    with pytest.raises(DataError, match="has no column '/drive/current'"):
        base.read(tmp_path / "a.csv", {"columns": {"sensor/a/0": "/drive/current"}})


def test_what_is_no_export(tmp_path: Path) -> None:
    header = HEADER.replace("/joint_states/hip", "/state")
    with pytest.raises(DataError, match="no position of a joint"):
        base.read(write(tmp_path / "a.csv", header))
    (tmp_path / "a.csv").write_text("__time,/s/a/position\n1.0,0.5\n0.5,0.6\n9.0,0.7\n")
    with pytest.raises(DataError, match="never run backwards"):
        base.read(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("__time,/s/a/position\n")
    with pytest.raises(DataError, match="holds no numbers"):
        base.read(tmp_path / "a.csv")
