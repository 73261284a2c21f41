"""SO-101 motion folders: names, units, and what is broken in them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import FromShared
from wt.data import recording as recordings
from wt.data.importers import base
from wt.errors import DataError

COUNT = 0.0015339807878856412  # rad, as it stands in the published files
ROWS = 200


def line(values: np.ndarray) -> str:
    return '"[' + ", ".join(str(v) for v in values) + ']"'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A motion: joint i is commanded 0.1·i and stands at i counts; the jaw opens."""
    motion = tmp_path / "motion"
    motion.mkdir()
    write(motion, velocity=COUNT * np.array([0.0, 50.0, -50.0, 0.0, 0.0, 100.0]), current=0.022814)
    return motion


def write(motion: Path, velocity: np.ndarray, current: float) -> None:
    command = 0.1 * np.arange(6)
    control, state = ["type,timestamp,positions"], ["type,timestamp,positions,velocities,torques"]
    for k in range(ROWS):
        stamp = 5.0 + 20_000.0 * k
        position = COUNT * np.arange(6)
        position[5] = 0.25 + (k % 5) * COUNT / 2.0  # a jaw that sweeps 2 rad from 0 to 1
        control.append(f"CONTROL,{stamp},{line(command)}")
        currents = np.full(6, current)
        state.append(f"STATE_MOTOR,{stamp},{line(position)},{line(velocity)},{line(currents)}")
    (motion / "control.csv").write_text("\n".join(control) + "\n")
    (motion / "state_motor.csv").write_text("\n".join(state) + "\n")
    names = "Rotation\nPitch\nElbow\nWrist_Pitch\nWrist_Roll\nJaw\n"
    (motion / "joint_list.txt").write_text(names)


def test_names_and_units(folder: Path) -> None:
    r = base.read(folder)
    assert r.rate_hz == pytest.approx(50.0)
    assert len(r) == ROWS
    joints = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    assert list(r.columns) == [f"{k}/{j}" for j in joints for k in ("ctrl", "qpos", "qvel")]
    assert r.columns["ctrl/wrist_flex"][0] == pytest.approx(0.3)
    assert r.columns["qpos/elbow_flex"][0] == pytest.approx(2 * COUNT)
    assert r.columns["qvel/elbow_flex"][0] == pytest.approx(-50 * COUNT)
    # jaw: 0…1 of -10°…100°, and its speed in the same unit although the servo turns 2 rad
    low, high = np.deg2rad([-10.0, 100.0])
    assert r.columns["ctrl/gripper"][0] == pytest.approx(low + 0.5 * (high - low), abs=1e-5)
    assert r.columns["qpos/gripper"][0] == pytest.approx(low + 0.25 * (high - low), abs=1e-5)
    assert r.columns["qvel/gripper"][0] == pytest.approx(100 * COUNT * (high - low) / 2, rel=1e-4)


def test_register_values_become_si(folder: Path) -> None:
    expected = base.read(folder).columns["qvel/shoulder_lift"][0]
    write(folder, velocity=np.array([0, 50, -50, 0, 0, 100]), current=3)
    assert base.read(folder).columns["qvel/shoulder_lift"][0] == pytest.approx(expected)


def test_the_map_renames(folder: Path) -> None:
    r = base.read(folder, {"joints": {"Jaw": "j6"}, "jaw_range": [0.0, 1.0], "meta": {"rate": 50}})
    assert r.columns["ctrl/j6"][0] == pytest.approx(0.5)
    assert r.meta["rate"] == 50
    with pytest.raises(DataError, match=r"'Rotatio'.*'Rotation'"):
        base.read(folder, {"joints": {"Rotatio": "a"}})


def test_broken_folders(folder: Path) -> None:
    def broken(name: str, change: str) -> str:
        copy = folder.with_name("broken")
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder, copy)
        text = (copy / name).read_text()
        (copy / name).write_text(
            text[:-60] if change == "cut" else text.replace(*change.split("|"))
        )
        with pytest.raises(DataError) as error:
            base.read(copy)
        assert "\n" not in str(error.value)
        return str(error.value)

    assert "state_motor.csv" in broken("state_motor.csv", "cut")
    assert "velocities" in broken("state_motor.csv", "velocities|speeds")
    assert "control.csv" in broken("control.csv", "0.1,|x,")
    assert "joint_list.txt" in broken("joint_list.txt", "Jaw|Claw")
    (folder / "control.csv").write_text(
        "\n".join((folder / "control.csv").read_text().splitlines()[:-7]) + "\n"
    )
    with pytest.raises(DataError, match="193 rows"):
        base.read(folder)


@pytest.mark.parametrize("motion", ["fast_transitions", "repeats/fast_transitions"])
def test_real_motions(motion: str, tmp_path: Path, from_shared: FromShared) -> None:
    """Published: 49.85 Hz; velocity must be the slope of position, jaw included."""
    r = base.read(from_shared("recordings/so101") / motion)
    recordings.write(r, tmp_path / "r.parquet")
    r = recordings.read(tmp_path / "r.parquet")
    assert r.rate_hz == pytest.approx(49.85, abs=0.01)
    for joint in ("shoulder_pan", "wrist_roll", "gripper"):
        position, velocity = r.columns[f"qpos/{joint}"], r.columns[f"qvel/{joint}"]
        slope = (position[2:] - position[:-2]) / (r.t[2:] - r.t[:-2])
        gain = velocity[2:] @ slope / (slope @ slope)  # the register is about one sample late
        assert gain == pytest.approx(1.0, abs=0.1), joint
