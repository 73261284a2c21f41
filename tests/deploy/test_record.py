"""What a run leaves is whole, is what happened, and is what wt's reader takes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.parquet as pq
import pytest

from deploy.record import LOG, RECORDING, Recorder, Table, state_columns, state_values
from deploy.robot import Command
from tests.deploy.conftest import standing
from wt.data.recording import check_against, read
from wt.diagnose.recordings.odometry import located
from wt.physics.scene import Scene
from wt.worlds import go2_model
from wt.worlds.robots import GO2

JOINTS = GO2.joints
ONE = np.ones(12)
POSE = np.array(GO2.default) + 0.01 * np.arange(12)


def recorded(seconds: float, follower: Callable[[np.ndarray], None] | None = None) -> Recorder:
    """Half of the time limp, then held; every tenth tick without a state."""
    recorder = Recorder(state_columns(JOINTS), JOINTS, ("stage",))
    if follower is not None:
        recorder.follow(follower)
    ticks = round(seconds * 500)
    for k in range(ticks):
        held = k >= ticks // 2
        command = Command(1e-4 * k * ONE, (50.0 if held else 0.0) * ONE, ONE)
        state = standing(7.0 + 0.002 * k, POSE + 1e-5 * k)
        heard = None if k % 10 == 9 else state.time
        recorder.row(0.002 * k, heard, state_values(state), command, (float(held),))
    return recorder


def test_the_recording_is_of_the_held_states_and_the_log_of_every_tick(tmp_path: Path) -> None:
    written = recorded(4.4).write(tmp_path / "new", {"robot": "go2"})
    assert written == [tmp_path / "new" / RECORDING, tmp_path / "new" / LOG]
    recording = read(written[0])
    check_against(recording, go2_model.build(go2_model.PUBLISHED, 0.005))
    rows = np.array([k for k in range(1100, 2200) if k % 10 != 9])
    np.testing.assert_allclose(recording.t, 0.002 * (rows - 1100), atol=1e-9)
    np.testing.assert_allclose(recording.columns["ctrl/FR_hip_joint"], 1e-4 * rows)
    k = JOINTS.index("FR_calf_joint")
    np.testing.assert_allclose(recording.columns["qpos/FR_calf_joint"], POSE[k] + 1e-5 * rows)
    assert recording.meta["robot"] == "go2"
    log = pq.read_table(written[1]).to_pandas()
    assert len(log) == 2200
    np.testing.assert_allclose(log["t"], 0.002 * np.arange(2200))
    assert np.isnan(log["ctrl/FR_hip_joint"][:1100]).all()
    assert np.isnan(log["qpos/FR_hip_joint"][9::10]).all()


def test_what_is_recorded_says_where_the_trunk_was(tmp_path: Path) -> None:
    path = tmp_path / "go2.xml"
    path.write_text(go2_model.spec(go2_model.PUBLISHED, 0.002).to_xml())
    model = mujoco.MjModel.from_xml_path(str(path))
    data, recorder = mujoco.MjData(model), Recorder(state_columns(JOINTS), JOINTS, ())
    mujoco.mj_resetDataKeyframe(model, data, 0)
    true = np.empty((1500, 3))
    for k in range(len(true)):
        t = 0.002 * k
        sway = min(t, 1.0) * 0.15 * np.sin(2 * np.pi * np.array([0.5, 0.8, 1.1] * 4) * t)
        data.ctrl[:] = np.array(GO2.default) + sway
        mujoco.mj_forward(model, data)
        imu = (data.sensor("gyro").data, data.sensor("orientation").data)
        measured = (data.qpos[7:], data.qvel[6:], data.actuator_force, *imu)
        true[k] = data.qpos[:3]
        command = Command(np.array(data.ctrl), 50.0 * ONE, ONE)
        recorder.row(t, t, np.concatenate(measured), command, ())
        mujoco.mj_step(model, data)
    recording = read(recorder.write(tmp_path / "run", {})[0])
    found = located(Scene(path), "base", recording.t, recording.columns)
    now = np.stack([found[f"qpos/base/{k}"] for k in range(3)], axis=1)
    assert np.ptp(true[500:, 2]) > 0.02
    assert np.abs((now - true)[500:, 2]).max() < 0.003
    drift = (now - now[500])[500:, :2] - (true - true[500])[500:, :2]
    assert np.abs(drift).max() < 0.2 * np.ptp(true[500:, :2])


def test_a_table_of_several_blocks_is_one() -> None:
    table = Table(["t", "x", "y"])
    for k in range(20_000):
        table.append(0.002 * k, np.array([k, -k]))
    expected = np.arange(20_000)[:, None] * np.array([0.002, 1, -1])
    np.testing.assert_allclose(table.rows(), expected)
    assert len(table) == 20_000


def test_a_recorder_is_restored_from_the_rows_that_its_follower_was_told(tmp_path: Path) -> None:
    told: list[np.ndarray] = []
    recorder = recorded(4.4, lambda row: told.append(row.copy()))
    recorder.write(tmp_path / "own", {})
    Recorder.restored(recorder.columns, np.array(told)).write(tmp_path / "restored", {})
    for name in (RECORDING, LOG):
        own, restored = (pq.read_table(tmp_path / f / name) for f in ("own", "restored"))
        for column in own.column_names:
            np.testing.assert_array_equal(own[column].to_numpy(), restored[column].to_numpy())


def test_a_short_run_leaves_its_log(tmp_path: Path) -> None:
    assert recorded(1.0).write(tmp_path, {}) == [tmp_path / LOG]
    assert pq.read_table(tmp_path / LOG).num_rows == 500
    assert sorted(p.name for p in tmp_path.iterdir()) == [LOG]


def test_a_run_without_a_tick_leaves_nothing(tmp_path: Path) -> None:
    assert recorded(0.0).write(tmp_path / "new", {}) == []
    assert not (tmp_path / "new").exists()


def test_an_interrupted_write_leaves_the_earlier_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded(1.0).write(tmp_path, {})
    before = (tmp_path / LOG).read_bytes()

    def broken(_: object, path: Path) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr("pyarrow.parquet.write_table", broken)
    with pytest.raises(KeyboardInterrupt):
        recorded(2.0).write(tmp_path, {})
    assert (tmp_path / LOG).read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == [LOG]
