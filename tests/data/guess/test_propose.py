"""Maps that are proposed for logs whose truth is known: read with them, the truth comes back."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml

from tests.data.importers.test_hdf5 import robomimic
from tests.data.importers.test_lerobot import write_dataset
from tests.data.importers.test_mcap import drives
from wt.cli.main import main
from wt.data import recording as recordings
from wt.data.guess.propose import propose
from wt.data.guess.text import text
from wt.data.importers import base
from wt.errors import DataError
from wt.types import Recording

T = 0.01 * np.arange(300)
Q = np.stack([0.4 * np.sin(3 * T) + 0.3 * np.sin(7.3 * T + 1), 0.5 * np.cos(2 * T)], axis=1)
V = np.stack([1.2 * np.cos(3 * T) + 2.19 * np.cos(7.3 * T + 1), -np.sin(2 * T)], axis=1)
U = np.stack([np.interp(T + 0.03, T, q) for q in Q.T], axis=1)
ARM = """
<mujoco><worldbody><body><joint name="shoulder_joint" range="-180 180" limited="true"/>
<geom size=".1"/><site name="s"/><body pos="1 0 0"><joint name="elbow_joint" range="-150 150"
limited="true"/><geom size=".1"/></body></body></worldbody><actuator>
<position name="m1" joint="shoulder_joint" kp="9"/><position name="m2" joint="elbow_joint" kp="9"/>
</actuator><sensor><gyro name="imu" site="s"/></sensor></mujoco>"""
TRUTH = {
    "qpos/shoulder_joint": Q[:, 0], "qpos/elbow_joint": Q[:, 1], "qvel/shoulder_joint": V[:, 0],
    "qvel/elbow_joint": V[:, 1], "ctrl/m1": U[:, 0], "ctrl/m2": U[:, 1],
}  # fmt: skip


@pytest.fixture(scope="module")
def arm() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM)


def mapped(path: Path, model: mujoco.MjModel | None) -> tuple[Recording, str]:
    """What the proposed map reads, and its text."""
    said = text(propose(path, model), path)
    return base.read(path, yaml.safe_load(said)), said


def assert_truth(r: Recording, atol: float = 1e-5) -> None:
    np.testing.assert_allclose(r.t - r.t[0], T, atol=1e-9)
    for column, truth in TRUTH.items():
        np.testing.assert_allclose(r.columns[column], truth, atol=atol, err_msg=column)


TABLES = {
    "microseconds and degrees, one velocity reversed": {
        "stamp_us": np.rint(1e6 * T).astype(int), "ShoulderPos": np.rad2deg(Q[:, 0]),
        "elbow_pos": np.rad2deg(Q[:, 1]), "shoulder_vel": np.rad2deg(V[:, 0]),
        "elbow vel": -np.rad2deg(V[:, 1]), "cmd_shoulder": np.rad2deg(U[:, 0]),
        "target_elbow": np.rad2deg(U[:, 1]), "temperature_1": 30.0 + 0.0 * T,
    },
    "positions in degrees, speeds in radians": {
        "time [ms]": 1e3 * T, "q_shoulder [deg]": np.rad2deg(Q[:, 0]), "dq_shoulder": V[:, 0],
        "q_elbow [deg]": np.rad2deg(Q[:, 1]), "dq_elbow": V[:, 1],
        "u_shoulder": U[:, 0], "u_elbow": U[:, 1],
    },
    "numbers for names, as of a robot's controller": {
        "timestamp": T, "actual_q_0": Q[:, 0], "actual_q_1": Q[:, 1], "actual_qd_0": V[:, 0],
        "actual_qd_1": V[:, 1], "target_q_0": U[:, 0], "target_q_1": U[:, 1],
    },
    "names that say nothing": {
        "a": T, "b": U[:, 0], "c": U[:, 1], "d": Q[:, 0], "e": Q[:, 1], "f": V[:, 0],
        "g": V[:, 1],
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_comes_back_true(kind: str, tmp_path: Path, arm: mujoco.MjModel) -> None:
    pd.DataFrame(TABLES[kind]).to_csv(tmp_path / "log.csv", index=False)
    r, said = mapped(tmp_path / "log.csv", arm)
    assert set(r.columns) == set(TRUTH), said
    assert_truth(r)
    assert ("order" in said) == ("name" in kind), said  # what was assumed is said
    assert ("it may be" in said) == ("reversed" in kind), said


def test_without_a_model_the_logs_names_stay(tmp_path: Path) -> None:
    kind = "microseconds and degrees, one velocity reversed"
    pd.DataFrame(TABLES[kind]).to_csv(tmp_path / "log.csv", index=False, sep=";")
    r, said = mapped(tmp_path / "log.csv", None)
    np.testing.assert_allclose(r.columns["qpos/shoulder"], Q[:, 0], atol=1e-6)
    np.testing.assert_allclose(r.columns["ctrl/elbow"], U[:, 1], atol=1e-6)
    np.testing.assert_allclose(r.columns["qvel/elbow"], V[:, 1], atol=1e-6)
    assert "#   temperature_1: no column of a recording" in said


def test_an_array_of_numbers_alone(tmp_path: Path, arm: mujoco.MjModel) -> None:
    np.save(tmp_path / "log.npy", np.concatenate([T[:, None], U, Q, V], axis=1))
    r, said = mapped(tmp_path / "log.npy", arm)
    assert_truth(r)
    assert "told by the motion alone" in said


COUNTED = """<mujoco><worldbody><body><joint name="my_joint1"/><geom size=".1"/>
<body><joint name="my_joint2"/><geom size=".1"/><body><joint name="my_joint3"/><geom size=".1"/>
<body><joint name="my_finger_joint1"/><geom size=".1"/></body></body></body></body></worldbody>
<actuator><position name="a1" joint="my_joint1"/><position name="a2" joint="my_joint2"/>
<position name="a3" joint="my_joint3"/></actuator></mujoco>"""


def test_a_log_that_counts_from_zero(tmp_path: Path) -> None:
    """Numbers of a log are places in an array; those of a model are names."""
    t = np.arange(300) / 100.0
    names = [f"{kind}_{i}" for i in range(3) for kind in ("actual_q", "actual_qd", "target_q")]
    columns = {}
    for i in range(3):
        q = np.sin((1.0 + i) * t)
        columns |= dict(zip(names[3 * i :], (q, np.gradient(q, t), q + 0.01), strict=False))
    path = tmp_path / "log.csv"
    pd.DataFrame({"timestamp": t} | columns).to_csv(path, index=False)
    proposal = propose(path, mujoco.MjModel.from_xml_string(COUNTED))
    said = {column: entry["column"] for column, entry in proposal.mapping["columns"].items()}
    for i in range(3):
        assert said[f"qpos/my_joint{i + 1}"] == f"actual_q_{i}"
        assert said[f"ctrl/a{i + 1}"] == f"target_q_{i}"
    assert any("counts from 0" in doubt for doubt in proposal.doubts)


def test_a_servo_without_speeds_is_told_by_what_it_follows(tmp_path: Path) -> None:
    volts = np.cos(40.0 * T)  # neither follows nor leads
    table = np.stack([T, volts, U[:, 0], Q[:, 0]], axis=1)
    np.save(tmp_path / "log.npy", table)
    r, said = mapped(tmp_path / "log.npy", None)
    assert set(r.columns) == {"qpos/joint0", "ctrl/joint0"}, said
    np.testing.assert_array_equal(r.columns["qpos/joint0"], Q[:, 0])
    assert "data/1: -1 … 1: what is it?" in said
    np.save(tmp_path / "log.npy", table[:, [0, 1, 3]])
    with pytest.raises(DataError, match="no row says"):
        propose(tmp_path / "log.npy")


def test_a_rate_is_told_by_the_speeds_or_doubted(tmp_path: Path, arm: mujoco.MjModel) -> None:
    np.savez(tmp_path / "log.npz", joint_pos=Q, joint_vel=V, action=U)
    r, said = mapped(tmp_path / "log.npz", arm)
    assert "time: {rate: 100.0}  # at this rate, speeds are the slopes" in said
    assert_truth(r)
    np.savez(tmp_path / "log.npz", joint_pos=Q, action=U)
    r, said = mapped(tmp_path / "log.npz", arm)
    assert "time: {rate: 50.0}  # a mere placeholder" in said
    assert "no row is a time" in said


def test_recordings_columns_find_the_models_names(tmp_path: Path, arm: mujoco.MjModel) -> None:
    columns = {"t": T, "qpos/arm_shoulder": Q[:, 0], "qpos/arm_elbow": Q[:, 1], "qpos/wheel": T,
               "ctrl/elbow": U[:, 1], "sensor/body_gyro/0": T}  # fmt: skip
    np.savez(tmp_path / "log.npz", **columns)
    r, said = mapped(tmp_path / "log.npz", arm)
    assert set(r.columns) == {
        "qpos/shoulder_joint", "qpos/elbow_joint", "ctrl/m2", "sensor/imu/0"
    }, said  # fmt: skip
    assert "wheel: no joint of the model is called so" in said
    assert "wheel: null" in said


def test_degrees_of_a_joint_without_limits(tmp_path: Path) -> None:
    free = mujoco.MjModel.from_xml_string(ARM.replace('limited="true"', 'limited="false"'))
    kind = "microseconds and degrees, one velocity reversed"
    pd.DataFrame(TABLES[kind]).to_csv(tmp_path / "log.csv", index=False)
    r, said = mapped(tmp_path / "log.csv", free)
    assert_truth(r)
    assert "is taken for degrees" in said


def test_percent_of_a_range_is_doubted_not_converted(tmp_path: Path, arm: mujoco.MjModel) -> None:
    table = {"t": T, "elbow_pos": 240.0 * Q[:, 1] + 90.0, "elbow_cmd": 240.0 * U[:, 1] + 90.0}
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    proposal = propose(tmp_path / "log.csv", arm)
    assert "units" not in proposal.mapping
    assert any("percent of a range" in doubt for doubt in proposal.doubts)


def test_several_episodes(tmp_path: Path) -> None:
    r, said = mapped(write_dataset(tmp_path), None)
    assert r.meta["episode"] == 0
    assert "there are several episodes" in said
    r, said = mapped(robomimic(tmp_path / "a.hdf5", control_freq=20), None)
    assert "qpos/joint6" in r.columns


def test_what_cannot_be_told_is_said(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("foo,bar\n" + "1,2\n" * 300)
    with pytest.raises(DataError, match=r"no row says.*: foo, bar"):
        propose(tmp_path / "log.csv")
    (tmp_path / "log.csv").write_text("")
    with pytest.raises(DataError, match="cannot be read as CSV"):
        propose(tmp_path / "log.csv")


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, model, out = tmp_path / "log.csv", tmp_path / "arm.xml", tmp_path / "map.yaml"
    pd.DataFrame(TABLES["numbers for names, as of a robot's controller"]).to_csv(log, index=False)
    model.write_text(ARM)
    guess = ["import", str(log), "--guess", "--model", str(model)]
    assert main(guess) == 0
    printed = capsys.readouterr().out
    assert main([*guess, "--to", str(out)]) == 0
    assert out.read_text() == printed
    assert "a map of log.csv with" in capsys.readouterr().out
    assert model.read_text() == ARM
    recording = tmp_path / "log.parquet"
    assert main(["import", str(log), "--map", str(out), "--to", str(recording)]) == 0
    loaded = mujoco.MjModel.from_xml_path(str(model))
    recordings.check_against(recordings.read(recording), loaded)
    # nothing is replaced, and what is missing is said
    for wrong in ([*guess, "--to", str(out)], [*guess, "--map", str(out)], ["import", str(log)]):
        capsys.readouterr()
        assert main(wrong) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert out.read_text() == printed


def test_messages_that_nobody_knows(tmp_path: Path) -> None:
    r, said = mapped(drives(tmp_path / "log.mcap"), None)
    assert "qpos/drives_drive_0: {topic: /drives, field: 'drive[0].angle'}" in said
    # the first runs over 24: degrees, and so is the second, which might be radians, unless told
    np.testing.assert_allclose(r.columns["qpos/drives_drive_1"], -np.deg2rad(T[:250:5]), atol=1e-9)
    assert "as qpos/drives_drive_0: see that it is not in radians" in said


def test_unitrees_motors_have_the_sdks_order_not_the_models(tmp_path: Path) -> None:
    """What PlotJuggler makes of /lowstate and /lowcmd; menagerie's Go2 begins with FL, not FR."""
    parts = ("hip", "thigh", "calf")
    legs = [f"{leg}_{part}" for leg in ("FL", "FR", "RL", "RR") for part in parts]
    chain = "".join(f'<body><joint name="{n}_joint"/><geom size=".1"/>' for n in legs)
    motors = "".join(f'<position name="{n}" joint="{n}_joint"/>' for n in legs)
    bodies = f"<worldbody>{chain}{'</body>' * 12}</worldbody>"
    xml = f"<mujoco>{bodies}<actuator>{motors}</actuator></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    t = 0.02 * np.arange(150)
    table = {"__time": 1e9 + t}
    for i in range(20):
        move = np.sin(t + i) if i < 12 else 0.0 * t
        table[f"/lowcmd/motor_cmd[{i}]/q"] = move
        table[f"/lowstate/motor_state[{i}]/q"] = move + 0.1 * (i < 12)
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False, float_format="%.9f")
    r, said = mapped(tmp_path / "log.csv", model)
    assert len(r.columns) == 24, said
    np.testing.assert_allclose(r.columns["qpos/FR_hip_joint"], np.sin(t) + 0.1, atol=1e-8)
    np.testing.assert_allclose(r.columns["ctrl/FL_hip"], np.sin(t + 3.0), atol=1e-8)
    assert "motor_state has 12 motors" in said
