"""Logs of the servo bench: what is a command and what is not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError


def entry(k: int) -> dict[str, float | bool]:
    return {
        "timestamp": 0.005 * k, "position": 0.001 * k, "speed": 0.2, "load": 65535 - 88,
        "input_volts": 7.0 + 0.1 * (k % 3), "temp": 30, "goal_position": 1.0,
        "torque_enable": k < 300,
    }  # fmt: skip


@pytest.fixture
def log(tmp_path: Path) -> Path:
    content = {"mass": 0.49, "length": 0.1, "kp": 200, "vin": 7.4, "motor": "xl330"}
    content |= {"trajectory": "sin", "entries": [entry(k) for k in range(500)]}
    (tmp_path / "log.json").write_text(json.dumps(content))
    return tmp_path / "log.json"


def test_a_torque_that_is_off_is_no_command(log: Path) -> None:
    r = base.read(log)
    assert list(r.columns) == ["ctrl/hinge", "qpos/hinge", "qvel/hinge"]
    assert (r.columns["ctrl/hinge"][:300] == 1.0).all()
    assert np.isnan(r.columns["ctrl/hinge"][300:]).all()
    assert (r.meta["kp"], r.meta["vin"]) == (200, 7.4)
    assert r.meta["supply_v"] == pytest.approx([7.0, 7.1, 7.2])
    assert r.meta["duty"] == pytest.approx(89 / 885)  # 65447 is −89 in two's complement


def test_broken_logs(log: Path) -> None:
    whole = log.read_text()
    for broken, said in (
        (whole[:-30], "whole JSON"),
        (whole.replace("goal_position", "goal"), "goal_position"),
        (whole.replace('"speed": 0.2', '"speed": "fast"'), "whole JSON"),
        (whole[: whole.index('"entries"')] + '"entries": []}', "without entries"),
    ):
        log.write_text(broken)
        with pytest.raises(DataError, match=said):
            base.read(log)


def test_real_logs(shared: Path) -> None:
    """Published: 6 s, about 5.3 ms a sample; lift_and_drop has the torque off for 75 %."""
    folder = shared / "recordings" / "bam_xl330"
    r = base.read(folder / "kp100_lift_and_drop.json")
    assert np.isnan(r.columns["ctrl/hinge"]).mean() == pytest.approx(0.75, abs=0.01)
    r = base.read(folder / "kp400_sin_sin.json")
    assert r.seconds == pytest.approx(6.0, abs=0.01)
    assert 1.0 / r.rate_hz == pytest.approx(5.3e-3, abs=1e-4)
    assert r.meta["kp"] == 400
