"""Topics of messages as a recording: what bags of ROS 1 and 2 and MCAP files share.

JointState is the state: positions, velocities, efforts (``force/``) under the joints' names.
Commands are JointTrajectory, Float64MultiArray and JointStates on a topic that is called so
(command, cmd, goal, target, desired, reference), held until the next. Imu becomes the sensors
``<topic>_gyro``, ``<topic>_accelerometer``, ``<topic>_orientation``, Odometry a free joint named
like its child frame. Unitree's LowState and LowCmd are read as both
(:mod:`wt.data.importers._unitree`). Everything is put on the time stamps of the state: of several
topics, the fastest JointState, or Odometry or Imu where there is none.

A message's header stamp is preferred over the time at which it was logged, topic by topic; where
the two clocks are more than a second apart (simulated time) and a topic has no header, all topics
go by the time of logging. The metadata says under ``clock`` what was used, and under ``assumed``
what the map could settle.

Map (all optional)::

    topics: {state: /joint_states, command: [/arm/commands], imu: [], odometry: /odom}
    order: [joint1, joint2]      # of a Float64MultiArray; JointState's order if left out
    command_field: effort        # position, velocity or effort, where a command has several
    columns:                     # numbers of any message, beside what is recognised or instead
      qpos/knee: {topic: /drives, field: "drive[2].angle", scale: 0.0174533}
    join: {"ctrl/*": {how: held, tolerance: 0.1}}   # see wt.data.importers._clock

Keys that every format has (joints, commands, units, signs, …) stand in
:mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

import abc
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float64

from wt.data import recording as recordings
from wt.data.importers import _messages, _unitree
from wt.data.importers import _ros_messages as ros
from wt.data.importers._clock import Stream, joined, stream
from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.data.importers._messages import Raw
from wt.data.importers._survey import Quantity, Survey
from wt.errors import DataError, WTError, suggest
from wt.types import Recording

KEYS = frozenset({"topics", "order", "command_field", "columns", "join"})
COMMANDS = re.compile(r"command|cmd|goal|target|desired|reference", re.IGNORECASE)
"""What a topic's name has if commands are sent on it."""
_SECOND = 10**9  # ns
_ROLES = ("state", "command", "imu", "odometry")
_LARGEST = 1 << 16  # B, of a message that is looked through for numbers: beyond are pictures
_COSTS = 3  # bytes in memory for a byte of a message, beside copies
_ENOUGH = 20  # messages of a topic that are none of the usual ones: the rest are not either


@dataclass
class _Topic:
    name: str
    type: str
    logged: list[int] = field(default_factory=list)
    stamps: list[int | None] = field(default_factory=list)
    messages: list[Any] = field(default_factory=list)

    def add(self, logged: int, stamp: int | None, message: Any) -> None:  # noqa: ANN401
        """Add a message, its time of logging and its header's stamp [ns]."""
        self.logged.append(logged)
        self.stamps.append(stamp)
        self.messages.append(message)

    def header_stamps(self) -> list[int] | None:
        """Header stamps [ns], or None where messages have none or leave it zero."""
        there = [stamp for stamp in self.stamps if stamp]
        return there if len(there) == len(self.stamps) else None


@dataclass
class _Log:
    """What was read of a log.

    Attributes:
        usual: topics in the form of ROS's usual messages.
        plain: topics as they are, where the map wants their numbers.
        types: of every topic.
        motors: Unitree's topics of motors, by package.
        misses: messages of a topic that were of no use.
        assumed: what the user should know.
        size: of all that was decoded [B].
    """

    usual: dict[str, _Topic] = field(default_factory=dict)
    plain: dict[str, _Topic] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    motors: dict[str, set[str]] = field(default_factory=dict)
    misses: Counter[str] = field(default_factory=Counter)
    assumed: list[str] = field(default_factory=list)
    size: int = 0


class TopicImporter(abc.ABC):
    """Base of importers of files that hold topics of messages."""

    name: ClassVar[str]
    keys: ClassVar[frozenset[str]] = KEYS
    general: ClassVar[bool] = False

    @abc.abstractmethod
    def messages(self, path: Path) -> Iterator[Raw]:
        """All messages of a file, in the order in which they were logged."""

    def read(self, path: Path, mapping: Map) -> Recording:
        """The topics as a recording.

        Raises:
            DataError: the file is broken, has no known topic, or the map does not fit it.
        """
        return recording(path, self.messages(path), mapping, self.name)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The numbers of all topics.

        Raises:
            DataError: the file is broken.
        """
        return survey(path, self.messages(path))


def recording(path: Path, raws: Iterable[Raw], mapping: Map, format: str) -> Recording:
    """The topics as a recording; see the module for what is what.

    Args:
        path: where they are from, for messages.
        raws: all messages.
        mapping: see the module.
        format: name of the importer.

    Raises:
        DataError: the file is broken, has no known topic, or the map does not fit it.
    """
    if mapping.get("command_field") not in (None, *ros.FIELDS):
        raise DataError(f"map command_field must be one of {', '.join(ros.FIELDS)}")
    wanted = _wanted(mapping)
    log = _read(path, raws, {str(entry["topic"]) for entry in wanted.values()})
    roles = _roles(path, list(log.usual.values()), mapping.get("topics", {}))
    picked = _picked(path, log, wanted)
    used = [topic for role in _ROLES for topic in roles[role]]
    named = [log.plain[name] for name, _ in picked]
    stamps, clock = _stamps([*used, *named])
    named_states, sent = _named(picked, stamps)
    states = [
        _without(_measured(topic, stamps[topic.name]), wanted)
        for topic in used
        if topic not in roles["command"]
    ]
    states = [s for s in (*states, *named_states) if s.columns]
    if not states:
        raise DataError(f"'{path}' has no measured state, only commands: record /joint_states")
    # JointState before a base's odometry before an Imu; the fastest of its kind
    primary = max(states, key=lambda s: (*_moves(s), len(s.stamps)))
    others = [s for s in states if s is not primary]
    assumed = list(log.assumed)
    sent += [
        _without(_commanded(topic, stamps[topic.name], mapping, primary, assumed), wanted)
        for topic in roles["command"]
    ]
    for i, command in enumerate(sent):
        twice = [name for s in (primary, *others, *sent[:i]) for name in s.columns
                 if name in command.columns]  # fmt: skip
        if twice:
            raise DataError(
                f"'{path}': '{twice[0]}' is sent on more than one topic; choose in the map with "
                f"'topics: {{command: …}}' among {', '.join(t.name for t in roles['command'])}"
            )
    columns = dict(primary.columns) | joined([*others, *sent], primary.stamps, mapping.get("join"))
    t = (primary.stamps - primary.stamps[0]) / _SECOND
    meta = {"source": path.name, "format": format, "clock": clock, "assumed": assumed}
    return Recording(t, columns, meta)


def survey(path: Path, raws: Iterable[Raw]) -> Survey:
    """All numbers in small messages, by topic and field.

    Raises:
        DataError: the file is broken.
    """
    log = _read(path, raws, None)
    quantities = []
    for topic in log.plain.values():
        for name in dict.fromkeys(_messages.numbers(topic.messages[0])):
            values = np.array([_messages.value(m, name) for m in topic.messages])
            entry = {"topic": topic.name, "field": name}
            quantities.append(Quantity(f"{topic.name}/{name}", entry, values))
    return Survey(quantities, timed=True)


def _without(source: Stream, names: Collection[str]) -> Stream:
    """A stream without columns that the map takes from elsewhere."""
    left = {name: values for name, values in source.columns.items() if name not in names}
    return Stream(source.stamps, left)


def _wanted(mapping: Map) -> dict[str, dict[str, Any]]:
    """The map's columns: recording column → {topic, field, scale}."""
    columns = mapping.get("columns", {})
    if not isinstance(columns, Mapping):
        raise DataError("map columns must be '<recording column>: {topic: …, field: …}' lines")
    wanted = {}
    for name, entry in columns.items():
        if entry is None:
            continue
        if not isinstance(entry, Mapping) or not {"topic", "field"} <= set(entry):
            raise DataError(
                f"map columns: {name!r} is {entry!r}; it must be {{topic: …, field: …}}"
            )
        refuse_unknown_keys(entry, {"topic", "field", "scale"})
        scale = entry.get("scale", 1.0)
        if isinstance(scale, bool) or not isinstance(scale, int | float):
            raise DataError(f"map: scale of {name!r} is {scale!r}; it must be a number")
        wanted[str(name)] = {**entry, "scale": float(scale)}
    return wanted


def _read(path: Path, raws: Iterable[Raw], wanted: set[str] | None) -> _Log:
    """All topics that are known or wanted, with their messages; with None, every one that is small.

    Args:
        path: for messages.
        raws: all messages.
        wanted: topics that are kept as they are too.
    """
    log = _Log()
    try:
        for raw in raws:
            if log.misses[raw.topic] < _ENOUGH and not _take(path, log, raw, wanted):
                log.misses[raw.topic] += 1
        _name_motors(log)
    except WTError:
        raise
    except Exception as error:  # its readers let through whatever a broken file makes them raise
        said = str(error).strip().splitlines() or [""]
        raise DataError(
            f"'{path}' is not a whole recording of messages ('ros2 bag reindex', 'rosbag reindex' "
            f"or 'mcap recover' may mend it): {type(error).__name__}: {said[0]}"
        ) from error
    if not log.usual and not log.plain:
        topics = [f"{name} ({type_})" for name, type_ in sorted(log.types.items())]
        raise DataError(
            f"'{path}' has no message of {', '.join(ros.TYPES)} or of Unitree's; its topics are "
            f"{', '.join(topics) or 'none'}; name their numbers in the map with 'columns: "
            "{qpos/<joint>: {topic: …, field: …}}'; 'wt import --guess' proposes it"
        )
    return log


def _take(path: Path, log: _Log, raw: Raw, wanted: set[str] | None) -> bool:
    """Keep a message if it is of use; False if it is not."""
    ours = raw.encoding in ("cdr", "ros1")
    log.types[raw.topic] = raw.type if ours else f"{raw.type} as {raw.encoding}"
    plain = raw.topic in wanted if wanted is not None else len(raw.data) <= _LARGEST
    if raw.decode is None or (ours and not plain and not _messages.known(raw)):
        return False
    log.size += len(raw.data)
    recordings.refuse_too_much(path, _COSTS * log.size)
    message = raw.decode(raw.data)
    stamp = _messages.stamp_of(message)
    usual = list(_messages.adapted(raw, message))
    for name, type_, each in usual:
        log.usual.setdefault(name, _Topic(name, type_)).add(raw.logged, stamp, each)
    if plain:
        log.plain.setdefault(raw.topic, _Topic(raw.topic, raw.type)).add(raw.logged, stamp, message)
    if _unitree.is_low_level(raw.type):
        log.motors.setdefault(raw.type.split("/")[0], set()).add(raw.topic)
    return bool(usual) or plain


def _name_motors(log: _Log) -> None:
    """Give the motors of Unitree's topics their joints' names."""
    for package, names in log.motors.items():
        topics = [log.usual[name] for name in names]
        sent = [m for t in topics if COMMANDS.search(t.name) for m in t.messages]
        states = [m for t in topics if not COMMANDS.search(t.name) for m in t.messages]
        log.assumed.append(_unitree.name_motors(states, sent, package))


_Picked = list[tuple[str, dict[str, Float64[np.ndarray, " _"]]]]


def _picked(path: Path, log: _Log, wanted: Mapping[str, Mapping[str, Any]]) -> _Picked:
    """(topic, columns) of what the map names."""
    by_topic: dict[str, dict[str, Float64[np.ndarray, " _"]]] = {}
    for name, entry in wanted.items():
        topic = log.plain.get(str(entry["topic"]))
        if topic is None:
            missing = str(entry["topic"])
            raise DataError(f"'{path}' has no topic {missing!r}: {suggest(missing, log.types)}")
        field = str(entry["field"])
        values = np.array([_messages.value(m, field) for m in topic.messages])
        if not np.isfinite(values).any():
            fields = _messages.numbers(topic.messages[0])
            raise DataError(
                f"topic '{topic.name}' has no number in {field!r}: {suggest(field, fields)}"
            )
        by_topic.setdefault(topic.name, {})[name] = entry["scale"] * values
    return list(by_topic.items())


def _named(
    picked: _Picked, stamps: Mapping[str, Sequence[int]]
) -> tuple[list[Stream], list[Stream]]:
    """What the map names, as measured streams and as commands."""
    measured: list[Stream] = []
    sent: list[Stream] = []
    for topic, columns in picked:
        for streams, of_commands in ((measured, False), (sent, True)):
            names = [n for n in columns if n.startswith("ctrl/") == of_commands]
            rows = [{n: columns[n][k] for n in names} for k in range(len(stamps[topic]))]
            if names:
                streams.append(stream(stamps[topic], rows))
    return measured, sent


def _roles(path: Path, topics: list[_Topic], wanted: object) -> dict[str, list[_Topic]]:
    """Topics by role (state, command, imu, odometry): by the map, else by type and name."""
    roles: dict[str, list[_Topic]] = {role: [] for role in _ROLES}
    for topic in topics:
        sent = topic.type in (ros.TRAJECTORY, ros.MULTI_ARRAY) or COMMANDS.search(topic.name)
        role = {ros.IMU: "imu", ros.ODOMETRY: "odometry"}.get(topic.type)
        roles[role or ("command" if sent else "state")].append(topic)
    if not isinstance(wanted, Mapping):
        raise DataError("map topics must be 'role: topic' lines, the role one of state, command, …")
    refuse_unknown_keys(wanted, set(_ROLES))
    by_name = {topic.name: topic for topic in topics}
    for role, names in wanted.items():
        listed = _listed(names, f"topics: {role}")
        for name in listed:
            if name not in by_name:
                raise DataError(f"'{path}' has no topic {name!r}: {suggest(str(name), by_name)}")
        chosen = [by_name[name] for name in listed]
        for other in _ROLES:
            roles[other] = [topic for topic in roles[other] if topic not in chosen]
        roles[role] = chosen
    return roles


def _listed(names: object, where: str) -> list[str]:
    """One name, or several, or none."""
    listed = [names] if isinstance(names, str) else names or []
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        raise DataError(f"map {where} is {names!r}; it must be a name or a list of names")
    return listed


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
    if order is not None:
        order = _listed(order, "order")
    else:
        order = [n.removeprefix("qpos/") for n in primary.columns if n.startswith("qpos/")]
        if len(order) > 1:
            assumed.append(
                f"topic '{topic.name}' names no joints: taken in the state's order "
                f"({', '.join(order)}); set in the map 'order: [joint, …]' if it is another"
            )
    return ros.multi_arrays(topic.name, stamps, topic.messages, order)
