"""ROS 2 recordings: .mcap and .db3 files and bag folders, with JointState and friends.

JointState is the state: positions, velocities, efforts (``force/``) under the joints' names.
Commands are JointTrajectory, Float64MultiArray and JointStates on a topic that is called so
(command, cmd, goal, target, desired, reference), held until the next. Imu becomes the sensors
``<topic>_gyro``, ``<topic>_accelerometer``, ``<topic>_orientation``, Odometry a free joint named
like its child frame. Everything is put on the time stamps of the state: of several topics, the
fastest JointState, or Odometry or Imu where there is none; other measurements are interpolated.

A message's header stamp is preferred over the time at which it was logged, topic by topic; where
the two clocks are more than a second apart (simulated time) and a topic has no header, all topics
go by the time of logging. The metadata says under ``clock`` what was used, and under ``assumed``
what the map could settle.

Map (all optional)::

    topics: {state: /joint_states, command: [/arm/commands], imu: [], odometry: /odom}
    order: [joint1, joint2]      # of a Float64MultiArray; JointState's order if left out
    command_field: effort        # position, velocity or effort, where a command has several

Keys that every format has (joints, commands, units, signs, …) stand in
:mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from wt.data.importers import _ros_messages as ros
from wt.data.importers._clock import Stream, joined
from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.data.importers.base import register
from wt.errors import DataError, suggest
from wt.types import Recording

_COMMANDS = re.compile(r"command|cmd|goal|target|desired|reference", re.IGNORECASE)
_SECOND = 10**9  # ns
_ROLES = ("state", "command", "imu", "odometry")


@dataclass
class _Topic:
    name: str
    type: str
    logged: list[int] = field(default_factory=list)
    messages: list[Any] = field(default_factory=list)

    def header_stamps(self) -> list[int] | None:
        """Header stamps [ns], or None where messages have none or leave it zero."""
        headers = [getattr(message, "header", None) for message in self.messages]
        stamps = [h.stamp.sec * _SECOND + h.stamp.nanosec if h else 0 for h in headers]
        return stamps if all(stamps) else None


@register
class Ros2:
    """Reads one recording."""

    name: ClassVar[str] = "ros2"
    about: ClassVar[str] = "an .mcap or .db3 file of ROS 2, or a bag folder with metadata.yaml"
    keys: ClassVar[frozenset[str]] = frozenset({"topics", "order", "command_field", "join"})
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file or folder by its name."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.is_file() and path.suffix in (".mcap", ".db3")

    def read(self, path: Path, mapping: Map) -> Recording:
        """The topics as a recording; see the module for what is what.

        Raises:
            DataError: the file is broken, has no known topic, or the map does not fit it.
        """
        if mapping.get("command_field") not in (None, *ros.FIELDS):
            raise DataError(f"map command_field must be one of {', '.join(ros.FIELDS)}")
        topics = _read(path)
        roles = _roles(path, topics, mapping.get("topics", {}))
        used = [topic for role in _ROLES for topic in roles[role]]
        stamps, clock = _stamps(used)
        states = [
            _measured(topic, stamps[topic.name]) for topic in used if topic not in roles["command"]
        ]
        states = [s for s in states if s.columns]
        if not states:
            raise DataError(f"'{path}' has no measured state, only commands: record /joint_states")
        # JointState before a base's odometry before an Imu; the fastest of its kind
        primary = max(states, key=lambda s: (*_moves(s), len(s.stamps)))
        columns = dict(primary.columns)
        assumed: list[str] = []
        others = [s for s in states if s is not primary]
        for topic in roles["command"]:
            sent = _commanded(topic, stamps[topic.name], mapping, primary, assumed)
            twice = [name for s in others for name in s.columns if name in sent.columns]
            if twice:
                raise DataError(
                    f"'{path}': '{twice[0]}' is sent on more than one topic, '{topic.name}' among "
                    "them; choose in the map with 'topics: {command: …}'"
                )
            others.append(sent)
        columns |= joined(others, primary.stamps, mapping.get("join"))
        t = (primary.stamps - primary.stamps[0]) / _SECOND
        meta = {"source": path.name, "format": self.name, "clock": clock, "assumed": assumed}
        return Recording(t, columns, meta)


def _read(path: Path) -> list[_Topic]:
    """All topics of known types with their messages."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)  # these types are the same in every distribution
    topics: dict[str, _Topic] = {}
    others: set[str] = set()
    try:
        for name, type_, logged, data in _raw(path):
            if type_ not in ros.TYPES:
                others.add(f"{name} ({type_})")
                continue
            topic = topics.setdefault(name, _Topic(name, type_))
            topic.logged.append(logged)
            topic.messages.append(store.deserialize_cdr(data, type_))
    except Exception as error:  # its readers let through whatever a broken file makes them raise
        raise DataError(
            f"'{path}' is not a whole ROS 2 recording ('ros2 bag reindex' or 'mcap recover' may "
            f"mend it): {type(error).__name__}: {error}"
        ) from error
    if not topics:
        raise DataError(
            f"'{path}' has no message of {', '.join(ros.TYPES)} in ROS 2's CDR; its topics are "
            f"{', '.join(sorted(others)) or 'none'}"
        )
    return list(topics.values())


def _raw(path: Path) -> Iterator[tuple[str, str, int, bytes]]:
    """(topic, type, log time [ns], CDR) of all messages; other encodings as their type's name."""
    if path.suffix == ".mcap":
        # mcap's reader takes files of any writer; that of rosbags wants a bag's profile
        from mcap.reader import make_reader

        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                type_ = schema.name if schema else "?"
                if channel.message_encoding != "cdr":
                    type_ = f"{type_} as {channel.message_encoding}"
                yield channel.topic, type_, message.log_time, message.data
        return
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:
        for connection, logged, data in reader.messages():
            yield connection.topic, connection.msgtype, logged, bytes(data)


def _roles(path: Path, topics: list[_Topic], wanted: object) -> dict[str, list[_Topic]]:
    """Topics by role (state, command, imu, odometry): by the map, else by type and name."""
    roles: dict[str, list[_Topic]] = {role: [] for role in _ROLES}
    for topic in topics:
        sent = topic.type in (ros.TRAJECTORY, ros.MULTI_ARRAY) or _COMMANDS.search(topic.name)
        role = {ros.IMU: "imu", ros.ODOMETRY: "odometry"}.get(topic.type)
        roles[role or ("command" if sent else "state")].append(topic)
    if not isinstance(wanted, Mapping):
        raise DataError("map topics must be 'role: topic' lines, the role one of state, command, …")
    refuse_unknown_keys(wanted, set(_ROLES))
    by_name = {topic.name: topic for topic in topics}
    for role, names in wanted.items():
        listed = [names] if isinstance(names, str) else list(names or [])
        for name in listed:
            if name not in by_name:
                raise DataError(f"'{path}' has no topic {name!r}: {suggest(str(name), by_name)}")
        chosen = [by_name[name] for name in listed]
        for other in _ROLES:
            roles[other] = [topic for topic in roles[other] if topic not in chosen]
        roles[role] = chosen
    return roles


def _stamps(topics: list[_Topic]) -> tuple[dict[str, list[int]], str]:
    """Stamps [ns] of every topic on one clock, and what that is."""
    headers = {topic.name: topic.header_stamps() for topic in topics}
    logged = {topic.name: topic.logged for topic in topics}
    without = [name for name, stamps in headers.items() if stamps is None]
    apart = [
        abs(float(np.median(np.subtract(stamps, logged[name]))))
        for name, stamps in headers.items()
        if stamps is not None
    ]
    if not apart or (without and max(apart) > _SECOND):
        why = "" if not apart else f", since {', '.join(without)} has none on the headers' clock"
        return logged, f"log time{why}"
    for name, stamps in headers.items():
        if stamps is not None and np.diff(stamps).min(initial=0) < -_SECOND:
            raise DataError(
                f"topic '{name}': header stamps jump back by more than a second (a restarted "
                "simulation?); cut the recording there"
            )
    clock = "header stamps" + (f"; log time of {', '.join(without)}" if without else "")
    return {name: stamps or logged[name] for name, stamps in headers.items()}, clock


def _moves(measured: Stream) -> tuple[bool, bool]:
    """True for positions of hinges or slides; True for positions at all."""
    positions = [name for name in measured.columns if name.startswith("qpos/")]
    return any(not name[-2:].startswith("/") for name in positions), bool(positions)


def _measured(topic: _Topic, stamps: Sequence[int]) -> Stream:
    if topic.type == ros.IMU:
        return ros.imu(topic.name, stamps, topic.messages)
    if topic.type == ros.ODOMETRY:
        return ros.odometry(stamps, topic.messages)
    return ros.joint_states(topic.name, stamps, topic.messages)


def _commanded(
    topic: _Topic, stamps: Sequence[int], mapping: Map, primary: Stream, assumed: list[str]
) -> Stream:
    chosen = mapping.get("command_field")
    if topic.type == ros.TRAJECTORY:
        return ros.trajectories(topic.name, stamps, topic.messages, chosen)
    if topic.type == ros.JOINT_STATE:
        return ros.joint_commands(topic.name, stamps, topic.messages, chosen)
    order = mapping.get("order")
    if order is None:
        order = [n.removeprefix("qpos/") for n in primary.columns if n.startswith("qpos/")]
        if len(order) > 1:
            assumed.append(
                f"topic '{topic.name}' names no joints: taken in the state's order "
                f"({', '.join(order)}); set in the map 'order: [joint, …]' if it is another"
            )
    return ros.multi_arrays(topic.name, stamps, topic.messages, order)
