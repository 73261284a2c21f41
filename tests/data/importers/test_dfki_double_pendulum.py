"""Runs of the double pendulum: names, and what the command is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError

HEADER = "time," + ",".join(
    f"{kind}{i}" for kind in ("pos_meas", "vel_meas", "pos_filt", "tau_con", "tau_fric", "tau_meas")
    for i in (1, 2)
)  # fmt: skip


@pytest.fixture
def run(tmp_path: Path) -> Path:
    rows = [
        f"{0.002 * k},{0.01 * k},{-0.02 * k},5,-10,99,99,1.5,-2.5,0.1,0.2,1.25,-2.25"
        for k in range(1100)
    ]
    (tmp_path / "trajectory.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    return tmp_path


def test_names_of_file_and_folder(run: Path) -> None:
    for source in (run, run / "trajectory.csv"):
        r = base.read(source)
        assert r.rate_hz == pytest.approx(500.0)
        first = {name: values[3] for name, values in r.columns.items()}
        assert first == {
            "ctrl/shoulder": 1.5, "qpos/shoulder": 0.03, "qvel/shoulder": 5.0,
            "force/shoulder": 1.25, "ctrl/elbow": -2.5, "qpos/elbow": -0.06, "qvel/elbow": -10.0,
            "force/elbow": -2.25,
        }  # fmt: skip


def test_broken_runs(run: Path) -> None:
    file = run / "trajectory.csv"
    whole = file.read_text()
    file.write_text(whole.replace("tau_meas2", "torque2"))
    with pytest.raises(DataError, match="tau_meas2"):
        base.read(run)
    file.write_text(whole.replace(",5,", ",x,"))
    with pytest.raises(DataError, match="table of numbers"):
        base.read(run)


def test_a_real_run(shared: Path) -> None:
    """Published: 500 Hz, dt 2.00 ms, 0 to 40 ms from commanded to measured torque."""
    r = base.read(shared / "recordings" / "dfki_double_pendulum" / "c1_144003")
    assert r.rate_hz == pytest.approx(500.0, rel=1e-3)
    assert r.seconds == pytest.approx(10.0, abs=0.01)
    assert 0.0 <= base.delays(r)["shoulder"] < 0.040
    assert base.doubts(r) == []
    assert np.abs(r.columns["ctrl/elbow"]).max() == 0.0
