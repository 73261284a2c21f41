"""ROS 2 bags and MCAP files that other programs wrote, read back."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from wt.data.importers import base
from wt.errors import DataError

STORE = get_typestore(Stores.ROS2_JAZZY)
START = 1_700_000_000 * 10**9  # ns
STATE, MULTI = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
Log = list[tuple[str, str, int, Any]]
"""(topic, type, log time [ns], message)"""


def make(kind: str, **fields: object) -> Any:  # noqa: ANN401
    return STORE.types[kind](**fields)


def header(ns: int, frame: str = "") -> Any:  # noqa: ANN401
    stamp = make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def state(ns: int, **values: list[float]) -> Any:  # noqa: ANN401
    arrays = {f: np.array(values.get(f, [])) for f in ("position", "velocity", "effort")}
    return make(STATE, header=header(ns), name=["lift", "pan"], **arrays)


def multi(*data: float) -> Any:  # noqa: ANN401
    layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return make(MULTI, layout=layout, data=np.array(data))


def ms(k: float) -> int:
    return START + round(k * 10**6)


def joint_log() -> Log:
    """States stamped every 10 ms and logged 3 ms later; commands every 25 ms, 2 ms off."""
    log: Log = []
    for k in range(300):
        t = 0.01 * k
        q, v = [np.sin(t), -2.0 * np.cos(t)], [np.cos(t), 2.0 * np.sin(t)]
        message = state(ms(10 * k), position=q, velocity=v, effort=[0.5, t])
        log.append(("/joint_states", STATE, ms(10 * k + 3), message))
    for k in range(120):
        log.append(("/arm/commands", MULTI, ms(25 * k + 2), multi(float(k), 1000.0 + k)))
    return sorted(log, key=lambda entry: entry[2])


def write_bag(path: Path, log: Log, storage: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    with BagWriter(path, version=9, storage_plugin=storage) as bag:
        topics = {
            topic: bag.add_connection(topic, kind, typestore=STORE)
            for topic, kind in {(topic, kind) for topic, kind, _, _ in log}
        }
        for topic, kind, logged, message in log:
            bag.write(topics[topic], logged, STORE.serialize_cdr(message, kind))
    return path


def write_mcap(path: Path, log: Log, **options: Any) -> Path:  # noqa: ANN401
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start()
        channels = {}
        for topic, kind in {(topic, kind) for topic, kind, _, _ in log}:
            text, _ = STORE.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, kind, logged, message in log:
            is_raw = isinstance(message, bytes)
            data = message if is_raw else bytes(STORE.serialize_cdr(message, kind))
            writer.add_message(channels[topic], logged, data, logged)
        writer.finish()
    return path


WRITERS: dict[str, Callable[[Path, Log], Path]] = {
    "sqlite": lambda folder, log: write_bag(folder / "bag", log),
    "bag of mcap": lambda folder, log: write_bag(folder / "bag", log, StoragePlugin.MCAP),
    "db3": lambda folder, log: next(write_bag(folder / "bag", log).glob("*.db3")),
    "mcap": lambda folder, log: write_mcap(folder / "log.mcap", log),
    "mcap lz4": lambda folder, log: write_mcap(
        folder / "log.mcap", log, compression=CompressionType.LZ4, chunk_size=2000
    ),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_states_and_commands_come_back(writer: str, tmp_path: Path) -> None:
    r = base.read(WRITERS[writer](tmp_path, joint_log()))
    np.testing.assert_allclose(r.t, 0.01 * np.arange(300), atol=1e-9)
    np.testing.assert_allclose(r.columns["qpos/lift"], np.sin(r.t))
    np.testing.assert_allclose(r.columns["qvel/pan"], 2.0 * np.sin(r.t), atol=1e-12)
    np.testing.assert_allclose(r.columns["force/pan"], r.t, atol=1e-9)
    # command k is sent at 25k + 2 ms: none at 0, command 0 from 10 ms, 1 from 30, 2 from 60
    np.testing.assert_array_equal(r.columns["ctrl/lift"][:7], [np.nan, 0, 0, 1, 1, 1, 2])
    np.testing.assert_array_equal(r.columns["ctrl/pan"][1:], 1000.0 + r.columns["ctrl/lift"][1:])
    assert r.meta["clock"] == "header stamps; log time of /arm/commands"
    assert "order" in str(r.meta["assumed"])


def test_order_names_and_fields_of_the_map(tmp_path: Path) -> None:
    source = write_bag(tmp_path / "bag", joint_log())
    mapping = {"order": ["pan", "lift"], "joints": {"lift": "j2"}, "commands": {"pan": "m1"}}
    r = base.read(source, mapping)
    assert r.columns["ctrl/m1"][1] == 0.0  # pan comes first now
    assert r.columns["ctrl/j2"][1] == 1000.0
    assert r.meta["assumed"] == []
    assert {"qpos/j2", "qpos/pan", "force/m1", "force/j2"} <= set(r.columns)
    with pytest.raises(DataError, match=r"'/arm/comands'.*'/arm/commands'"):
        base.read(source, {"topics": {"command": "/arm/comands"}})
    with pytest.raises(DataError, match=r"2 numbers for 3 joints"):
        base.read(source, {"order": ["a", "b", "c"]})
    # a machine without actuators may have none; that they are missed is doubted
    passive = base.read(source, {"topics": {"command": []}})
    assert any("ctrl/<actuator>" in said for said in base.doubts(passive))
    assert not any("ctrl/<actuator>" in said for said in base.doubts(r))


def test_cdr_written_by_hand(tmp_path: Path) -> None:
    """A JointState byte by byte as the OMG's CDR has it: little-endian, doubles aligned to 8."""
    log: Log = []
    for k in range(250):
        body = struct.pack("<iI", 1_700_000_000 + k // 100, k % 100 * 10**7)
        body += struct.pack("<I", 1) + b"\0" + b"\0" * 3  # frame_id "", then padding to 4
        body += struct.pack("<I", 1) + struct.pack("<I", 4) + b"arm\0"
        for values in ([0.5 * k], [50.0], []):
            body += struct.pack("<I", len(values))
            if values:
                body += b"\0" * (-len(body) % 8) + struct.pack(f"<{len(values)}d", *values)
        log.append(("/joint_states", STATE, ms(10 * k), b"\0\1\0\0" + body))
        command = make(STATE, header=header(ms(10 * k)), name=["arm"], position=np.array([0.5 * k]),
                       velocity=np.array([]), effort=np.array([]))  # fmt: skip
        log.append(("/joint_command", STATE, ms(10 * k), command))
    r = base.read(write_mcap(tmp_path / "a.mcap", log))
    np.testing.assert_allclose(r.columns["qpos/arm"], 0.5 * np.arange(250))
    np.testing.assert_allclose(r.columns["qvel/arm"], 50.0)
    np.testing.assert_allclose(r.columns["ctrl/arm"], r.columns["qpos/arm"])
    assert "force/arm" not in r.columns


def points(stamp: int, *goals: tuple[float, float]) -> Any:  # noqa: ANN401
    """A trajectory of joint lift: (seconds from start, position) each."""
    made = []
    for seconds, goal in goals:
        due = make("builtin_interfaces/msg/Duration", sec=int(seconds),
                   nanosec=round(seconds % 1 * 1e9))  # fmt: skip
        made.append(
            make("trajectory_msgs/msg/JointTrajectoryPoint", positions=np.array([goal]),
                 velocities=np.array([]), accelerations=np.array([]), effort=np.array([]),
                 time_from_start=due)
        )  # fmt: skip
    return make(TRAJECTORY, header=header(stamp), joint_names=["lift"], points=made)


def test_a_trajectory_commands_the_goal_it_moves_to(tmp_path: Path) -> None:
    log = [entry for entry in joint_log() if entry[0] == "/joint_states"]
    sent = points(ms(100), (0.5, 1.0), (1.0, 2.0), (1.5, 3.0))
    log.append(("/controller/joint_trajectory", TRAJECTORY, ms(90), sent))
    replaced = points(ms(1200), (0.1, 9.0))
    log.append(("/controller/joint_trajectory", TRAJECTORY, ms(1190), replaced))
    r = base.read(write_bag(tmp_path / "bag", log))
    command = dict(zip(np.round(r.t, 3).tolist(), r.columns["ctrl/lift"].tolist(), strict=True))
    assert np.isnan(command[0.09])
    # goal 1 until 0.6 s, goal 2 until 1.1 s, goal 3 until the second message cancels it
    assert [command[t] for t in (0.10, 0.59, 0.60, 1.09, 1.10, 1.19)] == [1, 1, 2, 2, 3, 3]
    assert [command[t] for t in (1.20, 2.99)] == [9, 9]


def base_log() -> Log:
    """A body turned 90° about z that moves along its own x at 2 m/s, with an Imu at 200 Hz."""
    log = joint_log()
    half = np.sqrt(0.5)
    vector, zeros = "geometry_msgs/msg/Vector3", np.zeros(36)
    for k in range(150):
        stamp, sign = ms(20 * k + 5), (-1.0) ** k  # q and -q are the same rotation
        pose = make(
            "geometry_msgs/msg/Pose",
            position=make("geometry_msgs/msg/Point", x=1.0, y=2.0 * (0.02 * k + 0.005), z=0.3),
            orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=sign * half,
                             w=sign * half),
        )  # fmt: skip
        twist = make("geometry_msgs/msg/Twist", linear=make(vector, x=2.0, y=0.0, z=0.0),
                     angular=make(vector, x=0.1, y=0.2, z=0.3))  # fmt: skip
        odometry = make(
            "nav_msgs/msg/Odometry", header=header(stamp, "odom"), child_frame_id="trunk",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=zeros),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros),
        )  # fmt: skip
        log.append(("/odom", "nav_msgs/msg/Odometry", stamp, odometry))
    for k in range(600):
        unknown = np.array([-1.0, *[0.0] * 8])
        message = make(
            "sensor_msgs/msg/Imu", header=header(ms(5 * k)), orientation_covariance=unknown,
            orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=0.0),
            angular_velocity=make(vector, x=0.005 * k, y=0.0, z=1.0),
            angular_velocity_covariance=np.zeros(9), linear_acceleration_covariance=np.zeros(9),
            linear_acceleration=make(vector, x=0.0, y=0.0, z=9.81),
        )  # fmt: skip
        log.append(("/imu/data", "sensor_msgs/msg/Imu", ms(5 * k), message))
    return log


def test_a_floating_base_and_its_imu(tmp_path: Path) -> None:
    mapping = {"joints": {"trunk": "root"}, "sensors": {"imu_data_gyro": "gyro"}}
    r = base.read(write_bag(tmp_path / "bag", base_log()), mapping)
    inside = (r.t > 0.01) & (r.t < 2.98)
    pose = np.stack([r.columns[f"qpos/root/{i}"] for i in range(7)], axis=1)[inside]
    np.testing.assert_allclose(pose[:, 0], 1.0)
    np.testing.assert_allclose(pose[:, 1], 2.0 * r.t[inside], atol=1e-9)  # between the samples
    np.testing.assert_allclose(
        np.abs(pose[:, 3:]), np.tile([0.5**0.5, 0, 0, 0.5**0.5], (inside.sum(), 1))
    )
    # along its own x is along the world's y; the angular velocity stays the body's
    speed = np.stack([r.columns[f"qvel/root/{i}"] for i in range(6)], axis=1)[inside]
    np.testing.assert_allclose(
        speed, np.tile([0, 2, 0, 0.1, 0.2, 0.3], (inside.sum(), 1)), atol=1e-12
    )
    np.testing.assert_allclose(r.columns["sensor/gyro/0"][inside], r.t[inside], atol=1e-9)
    np.testing.assert_allclose(r.columns["sensor/imu_data_accelerometer/2"], 9.81)
    assert not any("orientation" in name for name in r.columns)


def test_simulated_time_goes_by_the_log_unless_all_have_headers(tmp_path: Path) -> None:
    log: Log = [
        (topic, kind, logged, message)
        for topic, kind, logged, message in joint_log()
        if topic != "/joint_states"
    ]
    for k in range(300):
        message = state(10**9 + 10**7 * k, position=[0.1, 0.2])  # 1 s after the simulation's start
        log.append(("/joint_states", STATE, ms(10 * k + 3), message))
    r = base.read(write_bag(tmp_path / "bag", log))
    assert str(r.meta["clock"]).startswith("log time, since /arm/commands")
    # states at 3 ms, 13 ms, …: command 0 of 2 ms is in force at once, command 1 of 27 ms from 33 ms
    np.testing.assert_array_equal(r.columns["ctrl/lift"][:5], [0, 0, 0, 1, 1])


def test_broken_and_foreign_files(tmp_path: Path) -> None:
    def said(path: Path) -> str:
        with pytest.raises(DataError) as error:
            base.read(path)
        return str(error.value)

    bag = write_bag(tmp_path / "bag", joint_log())
    (tmp_path / "cut").mkdir()
    shutil.copy(bag / "metadata.yaml", tmp_path / "cut")
    assert "not a whole recording of messages" in said(tmp_path / "cut")
    (tmp_path / "cut" / "bag.db3").write_bytes(b"SQLite format 3\0" + bytes(500))
    assert "not a whole recording of messages" in said(tmp_path / "cut")
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    assert "not a whole recording of messages" in said(bag)
    whole = write_mcap(tmp_path / "log.mcap", joint_log()).read_bytes()
    (tmp_path / "half.mcap").write_bytes(b"\x89MCAP0\r\n" + whole[8:20])
    assert "not a whole recording of messages" in said(tmp_path / "half.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    assert "not a whole recording of messages" in said(tmp_path / "empty.mcap")
    text = make("std_msgs/msg/String", data="hello")
    chat = write_mcap(tmp_path / "chat.mcap", [("/chatter", "std_msgs/msg/String", START, text)])
    assert "/chatter (std_msgs/msg/String)" in said(chat)
    commands = [entry for entry in joint_log() if entry[0] != "/joint_states"]
    assert "no measured state" in said(write_bag(tmp_path / "commands", commands))
    twice = [*joint_log(), *[("/other", *entry[1:]) for entry in commands]]
    assert "topics: {command" in said(write_bag(tmp_path / "twice", twice))


def test_an_mcap_that_was_never_closed(tmp_path: Path) -> None:
    whole = write_mcap(tmp_path / "log.mcap", joint_log(), compression=CompressionType.NONE)
    whole.write_bytes(whole.read_bytes()[: int(0.6 * whole.stat().st_size)])
    with pytest.raises(DataError, match="mcap recover"):
        base.read(whole)


def test_an_mcap_of_json_says_so(tmp_path: Path) -> None:
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("foxglove.JointStates", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/joints", "json", schema), 1, b"{}", 1)
        writer.finish()
    with pytest.raises(DataError, match=r"/joints \(foxglove.JointStates as json\)"):
        base.read(tmp_path / "log.mcap")
