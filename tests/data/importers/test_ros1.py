"""Bags of ROS 1 as rosbags writes them: states, commands, Unitree's motors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.data.importers.test_ros2 import ms
from wt.data.importers import base
from wt.errors import DataError

STORE = get_typestore(Stores.ROS1_NOETIC)
STATE = "sensor_msgs/msg/JointState"
DRIVE = "maker_msgs/msg/Drive"
STORE.register(get_types_from_msg("float32 angle\nfloat32[2] volts", DRIVE))


def make(kind: str, **fields: object) -> Any:  # noqa: ANN401
    return STORE.types[kind](**fields)


def state(k: int, values: list[float]) -> Any:  # noqa: ANN401
    ns = ms(50 * k)
    stamp = make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    header = make("std_msgs/msg/Header", seq=k, stamp=stamp, frame_id="")
    none = np.array([])
    return make(STATE, header=header, name=["lift", "pan"], position=np.array(values),
                velocity=none, effort=none)  # fmt: skip


def write(path: Path) -> Path:
    with Writer(path) as bag:
        topics = {
            name: bag.add_connection(name, kind, typestore=STORE)
            for name, kind in (("/joint_states", STATE), ("/goal", STATE), ("/drive", DRIVE))
        }
        for k in range(50):
            log = [
                ("/joint_states", STATE, state(k, [0.05 * k, 1.0]), 3),
                ("/goal", STATE, state(k, [0.1 * k, 2.0]), 4),
                ("/drive", DRIVE, make(DRIVE, angle=0.5 * k, volts=np.zeros(2, np.float32)), 1),
            ]
            for name, kind, message, late in log:  # fmt: skip
                data = STORE.serialize_ros1(message, kind)
                bag.write(topics[name], ms(50 * k + late), data)
    return path


def test_states_and_commands(tmp_path: Path) -> None:
    r = base.read(write(tmp_path / "a.bag"))
    np.testing.assert_allclose(r.t, 0.05 * np.arange(50), atol=1e-9)
    np.testing.assert_allclose(r.columns["qpos/lift"], 0.05 * np.arange(50))
    np.testing.assert_allclose(r.columns["ctrl/lift"], 0.1 * np.arange(50))
    assert set(r.columns) == {"qpos/lift", "qpos/pan", "ctrl/lift", "ctrl/pan"}
    assert r.meta["clock"] == "header stamps"


def test_a_message_that_only_the_bag_defines(tmp_path: Path) -> None:
    entry = {"topic": "/drive", "field": "angle"}
    r = base.read(write(tmp_path / "a.bag"), {"columns": {"qpos/knee": entry}})
    # on the state's header stamps: 1 ms after the sample before it
    np.testing.assert_allclose(r.columns["qpos/knee"][1:4], 0.5 * np.array([0.98, 1.98, 2.98]))
    assert "log time of /drive" in str(r.meta["clock"])


def test_broken_bags(tmp_path: Path) -> None:
    whole = write(tmp_path / "a.bag").read_bytes()
    for content in (b"", b"#ROSBAG V1.2\n", whole[:500], whole[: len(whole) // 2]):
        (tmp_path / "a.bag").write_bytes(content)
        with pytest.raises(DataError, match="not a whole recording of messages"):
            base.read(tmp_path / "a.bag")
