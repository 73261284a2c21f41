"""MCAP files with channels of JSON and Protobuf, alone and beside ROS 2's."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP
from mcap.writer import Writer

from tests.data.importers.test_ros2 import MULTI, STORE, ms, multi
from wt.data.importers import base
from wt.errors import DataError

N = 50
T = 0.05 * np.arange(N)
Message = tuple[str, int, bytes]


def write(path: Path, channels: dict[str, tuple[str, str, bytes]], log: Iterable[Message]) -> Path:
    """Channels are (type, message encoding, schema) by topic."""
    kinds = {"json": "jsonschema", "protobuf": "protobuf", "cdr": "ros2msg"}
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        ids = {
            topic: writer.register_channel(
                topic, encoding, writer.register_schema(type_, kinds[encoding], schema)
            )
            for topic, (type_, encoding, schema) in channels.items()
        }
        for topic, logged, data in log:
            writer.add_message(ids[topic], logged, data, logged)
        writer.finish()
    return path


def as_json(topic: str, k: int, **content: Any) -> Message:  # noqa: ANN401
    return topic, ms(50 * k + 3), json.dumps(content).encode()


def stamp(k: int) -> dict[str, int]:
    return {"sec": ms(50 * k) // 10**9, "nsec": ms(50 * k) % 10**9}


def joint_states_in_json() -> list[Message]:
    """A ROS bridge's state; a command as Foxglove has it, with joints that are objects."""
    log = []
    for k in range(N):
        state = {
            "name": ["lift", "pan"],
            "position": [np.sin(T[k]), -T[k]],
            "velocity": [1.0, None],
        }
        log.append(as_json("/joint_states", k, header={"stamp": stamp(k)}, **state))
        joints = [{"name": "lift", "position": 2.0 * T[k]}, {"name": "pan", "position": 7.0}]
        log.append(as_json("/joint_command", k, timestamp=stamp(k), joints=joints))
    return log


JSON = {
    "/joint_states": ("sensor_msgs/msg/JointState", "json", b"{}"),
    "/joint_command": ("foxglove.JointStates", "json", b"{}"),
}


def test_joint_states_in_json(tmp_path: Path) -> None:
    r = base.read(write(tmp_path / "a.mcap", JSON, joint_states_in_json()))
    np.testing.assert_allclose(r.t, T, atol=1e-9)
    np.testing.assert_allclose(r.columns["qpos/lift"], np.sin(T))
    np.testing.assert_allclose(r.columns["ctrl/lift"], 2.0 * T)
    np.testing.assert_allclose(r.columns["qvel/lift"], 1.0)
    assert "qvel/pan" not in r.columns
    assert r.meta["clock"] == "header stamps"


def drive_schema() -> tuple[bytes, Any]:
    """A FileDescriptorSet with its dependency behind it, and the message's class."""
    file = descriptor_pb2.FileDescriptorProto(
        name="drives.proto", package="maker", syntax="proto3", dependency=[TIMESTAMP.name]
    )
    kinds = descriptor_pb2.FieldDescriptorProto
    drive = file.message_type.add(name="Drive")
    for i, field in enumerate(("angle", "target")):
        drive.field.add(name=field, number=i + 1, type=kinds.TYPE_DOUBLE, label=1)
    whole = file.message_type.add(name="Drives")
    whole.field.add(name="timestamp", number=1, type=kinds.TYPE_MESSAGE, label=1,
                    type_name=".google.protobuf.Timestamp")  # fmt: skip
    whole.field.add(name="drive", number=2, type=kinds.TYPE_MESSAGE, label=3,
                    type_name=".maker.Drive")  # fmt: skip
    timestamp = descriptor_pb2.FileDescriptorProto()
    TIMESTAMP.CopyToProto(timestamp)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(timestamp)
    pool.Add(file)
    made = message_factory.GetMessageClass(pool.FindMessageTypeByName("maker.Drives"))
    return descriptor_pb2.FileDescriptorSet(file=[file, timestamp]).SerializeToString(), made


def drives(path: Path) -> Path:
    """Protobuf beside a topic of ROS 2 that sends numbers in degrees."""
    schema, made = drive_schema()
    text, _ = STORE.generate_msgdef(MULTI, ros_version=2)
    log: list[Message] = []
    for k in range(N):
        message = made(drive=[{"angle": 10.0 * T[k], "target": 1.0}, {"angle": -T[k]}])
        message.timestamp.FromNanoseconds(ms(50 * k))
        log.append(("/drives", ms(50 * k + 5), message.SerializeToString()))
        sent = bytes(STORE.serialize_cdr(multi(90.0, 1.0 * k), MULTI))
        log.append(("/setpoints", ms(50 * k + 6), sent))
    channels = {"/drives": ("maker.Drives", "protobuf", schema),
                "/setpoints": (MULTI, "cdr", text.encode())}  # fmt: skip
    return write(path, channels, log)


MAP = {
    "topics": {"command": []},
    "columns": {
        "qpos/hip": {"topic": "/drives", "field": "drive[0].angle"},
        "qpos/knee": {"topic": "/drives", "field": "drive.1.angle", "scale": -2.0},
        "ctrl/hip": {"topic": "/setpoints", "field": "data[0]", "scale": np.pi / 180.0},
        "ctrl/knee": {"topic": "/setpoints", "field": "data[1]"},
    },
}


def test_numbers_of_any_message_by_topic_and_field(tmp_path: Path) -> None:
    r = base.read(drives(tmp_path / "a.mcap"), MAP)
    np.testing.assert_allclose(r.t, T, atol=1e-9)
    np.testing.assert_allclose(r.columns["qpos/hip"], 10.0 * T)
    np.testing.assert_allclose(r.columns["qpos/knee"], 2.0 * T)
    np.testing.assert_allclose(r.columns["ctrl/hip"][1:], np.pi / 2.0)
    # sample k is stamped before command k of the log's clock: command k - 1 is in force
    np.testing.assert_array_equal(r.columns["ctrl/knee"][:3], [np.nan, 0.0, 1.0])


def test_how_commands_are_joined_is_the_maps(tmp_path: Path) -> None:
    path = drives(tmp_path / "a.mcap")
    nearest = base.read(path, MAP | {"join": {"ctrl/*": {"how": "nearest", "tolerance": 0.01}}})
    np.testing.assert_array_equal(nearest.columns["ctrl/knee"][:3], [0.0, 1.0, 2.0])
    short = base.read(path, MAP | {"join": {"ctrl/*": {"how": "held", "tolerance": 0.04}}})
    assert np.isnan(short.columns["ctrl/knee"]).all()
    linear = base.read(path, MAP | {"join": {"ctrl/knee": "linear"}})
    np.testing.assert_allclose(linear.columns["ctrl/knee"][1:4], [0.88, 1.88, 2.88], atol=1e-6)
    for wrong, said in (
        ({"ctrl/hop": "held"}, "did you mean 'ctrl/hip'"),
        ({"ctrl/hip": "mean"}, "allowed: held, linear, nearest"),
        ({"ctrl/hip": {"how": "held", "tolerance": 0}}, "in s, over 0"),
        ({"ctrl/hip": {"how": "held", "within": 1}}, "'within' is not known"),
        (["held"], "must be"),
    ):
        with pytest.raises(DataError, match=said):
            base.read(path, MAP | {"join": wrong})


def test_what_the_map_names_must_be_there(tmp_path: Path) -> None:
    path = drives(tmp_path / "a.mcap")
    for entry, said in (
        ({"topic": "/drive", "field": "x"}, "did you mean '/drives'"),
        ({"topic": "/drives", "field": "drive[0].angel"}, r"did you mean 'drive\[0\].angle'"),
        ({"topic": "/drives"}, r"must be \{topic: …, field: …\}"),
        ({"topic": "/drives", "field": "drive[0].angle", "scale": "x"}, "must be a number"),
    ):
        with pytest.raises(DataError, match=said):
            base.read(path, {"columns": {"qpos/hip": entry}})
    channels = {"/drives": ("maker.Drives", "protobuf", b"\xff\xff")}
    with pytest.raises(DataError, match="not a whole recording of messages"):
        base.read(write(tmp_path / "b.mcap", channels, [("/drives", 1, b"")]))
    channels = {"/a": ("x", "json", b"{}")}
    for content in (b"{", b"[" * 100_000, b'{"name": ["a"], "position": ["b"]}'):
        with pytest.raises(DataError, match="not a whole recording of messages"):
            base.read(write(tmp_path / "b.mcap", channels, [("/a", 1, content)]))
