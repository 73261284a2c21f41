"""The Rerun recording, read back with Rerun's own reader."""

from __future__ import annotations

import dataclasses
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import rerun_cli
from rerun.chunk import RrdReader

from tests.diagnose import synthetic
from wt.diagnose.evidence import Interval
from wt.diagnose.report.rerun import PAUSE_S, playback
from wt.diagnose.result import Located


def read(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Rows by entity, static ones too."""
    rows: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for chunk in RrdReader(path).stream():
        rows[chunk.entity_path] += chunk.to_record_batch().to_pylist()
    return rows


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("rrd")
    path = folder / "diagnosis.rrd"
    path.write_bytes(playback(synthetic.diagnosis(str(synthetic.write_model(folder)))))
    yield path


@pytest.fixture(scope="module")
def rows(file: Path) -> dict[str, list[dict[str, Any]]]:
    return read(file)


def seconds(row: dict[str, Any]) -> float:
    return float(row["time"].total_seconds())


def test_rerun_takes_it_and_it_is_small(file: Path) -> None:
    binary = Path(rerun_cli.__file__).parent / "rerun"
    done = subprocess.run(
        [str(binary), "rrd", "verify", str(file)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert file.stat().st_size < 2e6


def test_three_robots_move_together(rows: dict[str, list[dict[str, Any]]]) -> None:
    times = []
    for robot in ("recorded", "before", "after"):
        moving = [r for r in rows[f"/world/{robot}/fore"] if r.get("time") is not None]
        times.append([seconds(r) for r in moving])
        assert rows[f"/world/{robot}/fore/hand"]
    assert times[0] == times[1] == times[2]
    assert len(times[0]) > 500


def test_poses_are_those_of_the_kinematics(rows: dict[str, list[dict[str, Any]]]) -> None:
    held = synthetic.diagnosis().traces[0]
    model = mujoco.MjModel.from_xml_string(synthetic.ARM)
    data = mujoco.MjData(model)
    for robot, positions in (("recorded", held.recorded), ("before", held.before)):
        moving = [r for r in rows[f"/world/{robot}/fore"] if r.get("time") is not None]
        row = moving[100]
        data.qpos[:] = positions[round(seconds(row) * synthetic.RATE)]
        mujoco.mj_kinematics(model, data)
        found = row["Transform3D:translation"][0]
        np.testing.assert_allclose(found, data.body("fore").xpos, atol=1e-5)


def test_errors_are_simulated_minus_recorded(rows: dict[str, list[dict[str, Any]]]) -> None:
    held = synthetic.diagnosis().traces[0]
    drawn = [r for r in rows["/error/j2/before"] if r.get("time") is not None]
    row = drawn[200]
    k = round(seconds(row) * synthetic.RATE)
    expected = held.before[k, 1] - held.recorded[k, 1]
    np.testing.assert_allclose(row["Scalars:scalars"], [expected], atol=1e-9)
    for group in ("position/j1/recorded", "position/j2/after", "force/j2/before", "error/j1/after"):
        assert len(rows[f"/{group}"]) > 500


def test_held_out_comes_first_and_events_are_logged(rows: dict[str, list[dict[str, Any]]]) -> None:
    events = sorted((seconds(r), r["TextLog:text"][0]) for r in rows["/log"])
    held = synthetic.diagnosis().traces[0]
    second = float(held.t[-1] - held.t[0]) + PAUSE_S
    assert [text for _, text in events][:2] == ["held.parquet, held out", "fit.parquet, fitted"]
    assert [when for when, _ in events] == pytest.approx([0.0, second, second + 2.1, second + 5.4])
    assert "joint j2 at speeds below 0.1 rad/s" in events[2][1]


def test_events_belong_to_their_recording(tmp_path: Path) -> None:
    full = synthetic.diagnosis(str(synthetic.write_model(tmp_path)))
    both = (Interval("held.parquet", 1.0, 2.0), Interval("fit.parquet", 3.0, 4.0))
    moved = dataclasses.replace(full, locations=(Located(synthetic.J2, 1.0, both),))
    (tmp_path / "a.rrd").write_bytes(playback(moved))
    events = sorted((seconds(r), r["TextLog:text"][0]) for r in read(tmp_path / "a.rrd")["/log"])
    held = full.traces[0]
    second = float(held.t[-1] - held.t[0]) + PAUSE_S
    assert [when for when, _ in events] == pytest.approx([0.0, 1.0, second, second + 3.0])
    assert events[1][1] == "joint j2 until 2.00 s"


def test_the_words_are_in_it(rows: dict[str, list[dict[str, Any]]]) -> None:
    (summary,) = rows["/summary"]
    assert "Joint j2 loses 0.81 N·m" in summary["TextDocument:text"][0]


def test_without_findings_there_is_no_robot_after(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    path.write_bytes(playback(synthetic.nothing(str(synthetic.write_model(tmp_path)))))
    entities = read(path)
    assert any(e.startswith("/world/before") for e in entities)
    assert not any("after" in e for e in entities)


def test_gaps_and_no_traces_are_survived(tmp_path: Path) -> None:
    full = synthetic.diagnosis(str(synthetic.write_model(tmp_path)))
    empty = np.full_like(full.traces[0].recorded, np.nan)
    odd = dataclasses.replace(full, traces=(dataclasses.replace(full.traces[0], before=empty),))
    (tmp_path / "gaps.rrd").write_bytes(playback(odd))
    assert "/position/j1/recorded" in read(tmp_path / "gaps.rrd")
    (tmp_path / "none.rrd").write_bytes(playback(dataclasses.replace(full, traces=())))
    assert "/summary" in read(tmp_path / "none.rrd")
