"""What every format has: names, units, signs and offsets of a map, checks, and delays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError
from wt.types import Recording

T = 0.01 * np.arange(800)
ANGLE = 0.4 * np.sin(3.0 * T) + 0.3 * np.sin(7.3 * T + 1.0)
SPEED = 1.2 * np.cos(3.0 * T) + 2.19 * np.cos(7.3 * T + 1.0)


def read(
    folder: Path, mapping: dict[str, object] | None = None, **changed: np.ndarray
) -> Recording:
    late = np.interp(T - 0.03, T, ANGLE)
    columns = {"ctrl/a": ANGLE, "qpos/a": late, "qvel/a": np.interp(T - 0.03, T, SPEED)}
    columns |= {name.replace("_", "/"): values for name, values in changed.items()}
    np.savez(folder / "a.npz", **{"t": T, **columns})
    return base.read(folder / "a.npz", mapping)


def test_names(tmp_path: Path) -> None:
    r = read(tmp_path, {"joints": {"a": "hip"}}, sensor_imu=T)
    assert set(r.columns) == {"ctrl/hip", "qpos/hip", "qvel/hip", "sensor/imu"}
    mapping = {"joints": {"a": "hip"}, "commands": {"a": "motor"}, "sensors": {"imu": None}}
    r = read(tmp_path, mapping, sensor_imu=T)
    assert set(r.columns) == {"ctrl/motor", "qpos/hip", "qvel/hip"}
    with pytest.raises(DataError, match=r"joints: 'b' is not in the source.*allowed: a"):
        read(tmp_path, {"joints": {"b": "hip"}})
    with pytest.raises(DataError, match="two columns would be 'qpos/b'"):
        read(tmp_path, {"joints": {"a": "b"}}, qpos_b=T)


def test_single_columns_go_before_names(tmp_path: Path) -> None:
    mapping = {"joints": {"a": "hip"}, "channels": {"qpos/a": "qpos/knee", "qvel/a": None}}
    assert set(read(tmp_path, mapping).columns) == {"ctrl/hip", "qpos/knee"}
    swapped = read(tmp_path, {"channels": {"ctrl/a": "qpos/a", "qpos/a": "ctrl/a"}})
    np.testing.assert_array_equal(swapped.columns["qpos/a"], ANGLE)


def test_units_signs_and_offsets(tmp_path: Path) -> None:
    mapping = {"units": {"*/a": "deg"}, "signs": {"*/a": -1}, "offsets": {"qpos/a": 0.5}}
    plain, r = read(tmp_path), read(tmp_path, mapping)
    factor = -0.017453292519943295
    np.testing.assert_allclose(r.columns["qpos/a"], factor * plain.columns["qpos/a"] + 0.5)
    np.testing.assert_allclose(r.columns["ctrl/a"], factor * plain.columns["ctrl/a"])
    assert read(tmp_path, {"units": {"ctrl/a": 0.5}}).columns["ctrl/a"][9] == 0.5 * ANGLE[9]
    assert read(tmp_path, {"meta": {"robot": "r2"}}).meta["robot"] == "r2"


def test_any_column_can_be_dropped(tmp_path: Path) -> None:
    mapping = {"joints": {"a": "hip"}, "drop": ["qvel/*", "sensor/imu/0"]}
    r = read(tmp_path, mapping, sensor_imu_0=T, sensor_imu_1=T)
    assert set(r.columns) == {"ctrl/hip", "qpos/hip", "sensor/imu/1"}


@pytest.mark.parametrize(
    ("mapping", "said"),
    [
        ({"drop": "qvel/a"}, r"must be a list"),
        ({"drop": ["qvel/b"]}, "did you mean 'qvel/a'"),
        ({"units": {"qpos/a": "degrees"}}, "'degrees' is not known"),
        ({"units": {"qpos/a": True}}, "must be a number"),
        ({"signs": {"qpos/a": 2}}, "1 or -1"),
        ({"signs": {"qpos/b": -1}}, "did you mean 'qpos/a'"),
        ({"offsets": 3}, "name: value"),
        ({"channels": {"qpos/b": None}}, "channels: 'qpos/b' is not in the source; did you mean"),
        ({"channels": {"qvel/a": "speed"}}, "is to be 'speed'; give a column"),
        ({"channels": {"qvel/a": "qpos/a"}}, "two columns would be 'qpos/a'"),
        ({"sings": {}}, "did you mean 'signs'"),
        ({"meta": "mine"}, "key: value"),
    ],
)
def test_maps_that_do_not_fit(tmp_path: Path, mapping: dict[str, object], said: str) -> None:
    with pytest.raises(DataError, match=said):
        read(tmp_path, mapping)


def test_a_velocity_that_is_not_the_slope_is_refused(tmp_path: Path) -> None:
    late = np.interp(T - 0.03, T, SPEED)
    with pytest.raises(DataError, match=r"'qvel/a' runs against.*signs: {qvel/a: -1}"):
        read(tmp_path, qvel_a=-late)
    assert read(tmp_path, {"signs": {"qvel/a": -1}}, qvel_a=-late).columns["qvel/a"][9] == late[9]
    with pytest.raises(DataError, match=r"'qvel/a' looks like degrees.*units: {qvel/a: deg}"):
        read(tmp_path, qvel_a=np.rad2deg(late))
    with pytest.raises(DataError, match=r"'qpos/a' looks like degrees.*units: {qpos/a: deg}"):
        read(tmp_path, qvel_a=np.deg2rad(late))
    # what the map says of a column itself is believed
    read(tmp_path, {"units": {"qvel/a": "SI"}}, qvel_a=np.rad2deg(late))
    read(tmp_path, {"signs": {"qvel/a": 1}}, qvel_a=-late)


def test_commands_that_nothing_follows_are_doubted(tmp_path: Path) -> None:
    assert base.doubts(read(tmp_path)) == []
    (line,) = base.doubts(read(tmp_path, ctrl_a=-ANGLE))
    assert "'qpos/a' runs against 'ctrl/a'" in line
    assert "signs: {ctrl/a: -1}" in line
    (line,) = base.doubts(read(tmp_path, ctrl_a=np.rad2deg(ANGLE)))
    assert "units: {ctrl/a: deg}" in line
    (line,) = base.doubts(read(tmp_path, qvel_a=7.0 * np.interp(T - 0.03, T, SPEED)))
    assert "7.03 times the slope" in line  # a central difference is a little low
    assert "units: {qvel/a: 0.142}" in line
    settled = {"signs": {"ctrl/a": 1}}
    assert base.doubts(read(tmp_path, settled, ctrl_a=-ANGLE), settled) == []


def test_degrees_without_a_velocity_are_doubted(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **{"t": T, "ctrl/a": 100.0 * ANGLE, "qpos/a": 100.0 * ANGLE})
    (line,) = base.doubts(base.read(tmp_path / "a.npz"))
    assert "units: deg" in line


def test_delays_of_motion_and_force(tmp_path: Path) -> None:
    assert base.delays(read(tmp_path)) == {"a": pytest.approx(0.030, abs=2e-3)}
    torque = np.interp(T - 0.012, T, ANGLE)
    assert base.delays(read(tmp_path, force_a=torque)) == {"a": pytest.approx(0.012, abs=2e-3)}
    # a servo that is off for a while still tells
    command = np.where(T < 4.0, ANGLE, np.nan)
    assert base.delays(read(tmp_path, ctrl_a=command)) == {"a": pytest.approx(0.030, abs=2e-3)}
    assert base.delays(read(tmp_path, ctrl_a=np.zeros(len(T)))) == {}
