"""Unitree's LowState and LowCmd in bags, with the definitions kept in them and without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.data.importers.test_ros2 import ms
from wt.data.importers import base
from wt.data.importers._unitree import DEFINITIONS

STORE = get_typestore(Stores.ROS2_HUMBLE)
for name, text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(text, name))


def filled(kind: str, **given: Any) -> Any:  # noqa: ANN401
    """A message with zeros where nothing is given."""
    fields = {}
    for field, (node, detail) in STORE.fielddefs[kind][1]:
        if node.name == "BASE":
            fields[field] = 0.0 if detail[0].startswith("float") else 0
        elif node.name == "NAME":
            fields[field] = filled(detail)
        else:
            (inner, of), count = detail
            dtype = of[0] if inner.name == "BASE" else None
            fields[field] = np.zeros(count, dtype) if dtype else [filled(of) for _ in range(count)]
    return STORE.types[kind](**(fields | given))


def log(path: Path, package: str, motors: int, slots: int, kp: float = 20.0) -> Path:
    """States at 20 Hz and commands 2 ms before them; motor i at i + sin."""
    types = {"/lowstate": f"{package}/msg/LowState", "/lowcmd": f"{package}/msg/LowCmd"}
    with Writer(path, version=8) as bag:
        topics = {n: bag.add_connection(n, t, typestore=STORE) for n, t in types.items()}
        for k in range(45):
            q = [i + np.sin(0.05 * k) if i < motors else 0.0 for i in range(slots)]
            state = [filled(f"{package}/msg/MotorState", q=x, dq=0.1 * (x != 0.0)) for x in q]
            sent = [filled(f"{package}/msg/MotorCmd", q=2.146e9 if i == 1 else x + 0.5, tau=3.0 * i,
                           kp=kp) for i, x in enumerate(q)]  # fmt: skip
            quaternion = np.array([1, 0, 0, 0], np.float32)
            gyroscope = np.array([0.0, 0.05 * k, 0.0], np.float32)
            imu = filled(f"{package}/msg/IMUState", quaternion=quaternion, gyroscope=gyroscope)
            messages = {
                "/lowstate": filled(types["/lowstate"], motor_state=state, imu_state=imu),
                "/lowcmd": filled(types["/lowcmd"], motor_cmd=sent),
            }
            for name, message in messages.items():
                data = STORE.serialize_cdr(message, types[name])
                bag.write(topics[name], ms(50 * k + (2 if name == "/lowstate" else 0)), data)
    return path


def test_a_quadruped(tmp_path: Path) -> None:
    bag = log(tmp_path / "bag", "unitree_go", 12, 20)
    r = base.read(next(bag.glob("*.db3")))
    assert sum(name.startswith("qpos/") for name in r.columns) == 12
    np.testing.assert_allclose(r.columns["qpos/FL_calf_joint"], 5.0 + np.sin(r.t), atol=1e-6)
    np.testing.assert_allclose(r.columns["ctrl/FL_calf_joint"], 5.5 + np.sin(r.t), atol=1e-6)
    assert np.isnan(r.columns["ctrl/FR_thigh_joint"]).all()  # "no position"
    np.testing.assert_allclose(r.columns["sensor/lowstate_imu_gyro/1"], r.t, atol=1e-6)
    assert "quadruped" in str(r.meta["assumed"])


def test_torques_are_the_command_where_no_gain_is_set(tmp_path: Path) -> None:
    r = base.read(log(tmp_path / "bag", "unitree_go", 12, 20, kp=0.0))
    np.testing.assert_allclose(r.columns["ctrl/FL_calf_joint"], 15.0)


@pytest.mark.parametrize(("motors", "column"), [(29, "qpos/waist_yaw_joint"), (7, "qpos/motor6")])
def test_humanoids(motors: int, column: str, tmp_path: Path) -> None:
    r = base.read(log(tmp_path / "bag", "unitree_hg", motors, 35))
    assert sum(name.startswith("qpos/") for name in r.columns) == motors
    k = 12 if motors == 29 else 6
    np.testing.assert_allclose(r.columns[column], k + np.sin(r.t), atol=1e-5)
