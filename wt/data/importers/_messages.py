"""Messages of logs in any encoding, decoded into objects whose fields are attributes.

JSON and Protobuf bring their fields with them; ROS messages beyond the usual ones are decoded with
the definition that the log keeps. A message of JSON or Protobuf counts as a JointState if it has
the fields of one (``name``, ``position``, …), as ROS bridges write it, or a list ``joints`` of
such, as Foxglove's ``JointStates``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from wt.data.importers import _ros_messages as ros
from wt.data.importers import _unitree

_FIELDS = ("position", "velocity", "effort")
_SECONDS, _NANOS = ("sec", "secs", "seconds"), ("nanosec", "nsec", "nsecs", "nanos")
_DEEPEST, _WIDEST = 8, 64  # of what is looked through for numbers
_STEP = re.compile(r"[^.\[\]]+")

Decoder = Callable[[bytes], Any]


@dataclass(frozen=True)
class Raw:
    """One message as it was logged.

    Attributes:
        topic: where it was sent.
        type: of it, ``package/msg/Name`` where it is ROS's.
        encoding: cdr, ros1, json, protobuf, ….
        logged: when [ns].
        data: its bytes.
        decode: makes an object of them; None for an encoding that is not known.
    """

    topic: str
    type: str
    encoding: str
    logged: int
    data: bytes
    decode: Decoder | None


def ros_decoders(ros_version: int) -> Callable[[str, str], Decoder]:
    """Decoders of ROS messages by (type, definition); an empty definition where the log has none.

    Args:
        ros_version: 1 or 2.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    # the usual types are the same in every distribution
    store = get_typestore(Stores.ROS2_HUMBLE if ros_version == 2 else Stores.ROS1_NOETIC)
    read = store.deserialize_cdr if ros_version == 2 else store.deserialize_ros1

    def decoder(type_: str, definition: str) -> Decoder:
        def decode(data: bytes) -> Any:  # noqa: ANN401
            if type_ not in store.fielddefs:
                if definition:
                    store.register(get_types_from_msg(definition, type_))
                elif type_ in _unitree.DEFINITIONS:
                    for name, text in _unitree.DEFINITIONS.items():
                        store.register(get_types_from_msg(text, name))
            return read(data, type_)

        return decode

    return decoder


def bag_messages(
    reader: Any,  # noqa: ANN401
    decoder: Callable[[str, str], Decoder],
    encoding: str,
) -> Iterator[Raw]:
    """All messages of an opened bag.

    Args:
        reader: one of rosbags'.
        decoder: as :func:`ros_decoders` gives it.
        encoding: of the messages.
    """
    decoders = {c.id: decoder(c.msgtype, c.msgdef.data) for c in reader.connections}
    for connection, logged, data in reader.messages():
        decode = decoders[connection.id]
        yield Raw(connection.topic, connection.msgtype, encoding, logged, bytes(data), decode)


def from_json(data: bytes) -> Any:  # noqa: ANN401
    """An object of JSON's; its members are attributes."""
    return json.loads(data, object_hook=lambda members: SimpleNamespace(**members))


def protobuf_decoder(descriptors: bytes, type_: str) -> Decoder:
    """A decoder of Protobuf messages.

    Args:
        descriptors: a FileDescriptorSet, as MCAP keeps it.
        type_: full name of the message.
    """
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    files = {f.name: f for f in descriptor_pb2.FileDescriptorSet.FromString(descriptors).file}
    pool = descriptor_pool.DescriptorPool()

    def add(name: str) -> None:
        file = files.pop(name, None)
        if file is not None:
            for other in file.dependency:
                add(other)
            pool.Add(file)

    for name in list(files):
        add(name)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(type_)).FromString


def known(raw: Raw) -> bool:
    """True for a type that is read without a map; JSON and Protobuf have to be looked into."""
    return raw.type in ros.TYPES or _unitree.is_low_level(raw.type)


def adapted(raw: Raw, message: Any) -> Iterator[tuple[str, str, Any]]:  # noqa: ANN401
    """(topic, type, message) in the form of the usual ROS messages; nothing if it is none.

    Args:
        raw: the message as it was logged.
        message: decoded.
    """
    if _unitree.is_low_level(raw.type):
        yield raw.topic, ros.JOINT_STATE, _unitree.motors(message)
        if hasattr(message, "imu_state"):
            yield f"{raw.topic}/imu", ros.IMU, _unitree.imu(message)
    elif raw.encoding in ("cdr", "ros1"):
        if raw.type in ros.TYPES:
            yield raw.topic, raw.type, message
    elif (state := _joint_state(message)) is not None:
        yield raw.topic, ros.JOINT_STATE, state


def stamp_of(message: Any) -> int | None:  # noqa: ANN401
    """Header stamp [ns], or None where a message has none."""
    header = getattr(message, "header", None)
    stamp = next(
        (s for s in (getattr(header, "stamp", None), getattr(message, "timestamp", None)) if s),
        None,
    )
    seconds = next((getattr(stamp, n) for n in _SECONDS if hasattr(stamp, n)), None)
    nanos = next((getattr(stamp, n) for n in _NANOS if hasattr(stamp, n)), None)
    if not isinstance(seconds, int) or not isinstance(nanos, int):
        return None
    return seconds * 10**9 + nanos


def value(message: Any, field: str) -> float:  # noqa: ANN401
    """A number in a message; NaN where it is not there.

    Args:
        message: decoded.
        field: its path, ``motor_state[3].q``.
    """
    here = message
    for step in _STEP.findall(field):
        if step.isdigit() and _is_list(here):
            here = here[int(step)] if int(step) < len(here) else None
        else:
            here = getattr(here, step, None)
    try:
        return float(here)
    except (TypeError, ValueError):
        return float("nan")


def numbers(message: Any, path: str = "", depth: int = 0) -> Iterator[str]:  # noqa: ANN401
    """Paths of all numbers in a message, long lists left out."""
    if depth > _DEEPEST:
        return
    if _is_list(message):
        if len(message) <= _WIDEST:
            for i, inner in enumerate(message):
                yield from numbers(inner, f"{path}[{i}]", depth + 1)
    elif isinstance(message, int | float) or (not _members(message) and _is_number(message)):
        yield path
    else:
        for name in _members(message):
            inner = f"{path}.{name}" if path else name
            yield from numbers(getattr(message, name), inner, depth + 1)


def _members(message: Any) -> list[str]:  # noqa: ANN401
    descriptor = getattr(message, "DESCRIPTOR", None)
    if descriptor is not None:
        return [f.name for f in descriptor.fields]
    return [n for n in getattr(message, "__dict__", {}) if not n.startswith("_")]


def _is_list(message: Any) -> bool:  # noqa: ANN401
    return hasattr(message, "__len__") and hasattr(message, "__getitem__") and not isinstance(
        message, str | bytes | dict
    )  # fmt: skip


def _is_number(message: Any) -> bool:  # noqa: ANN401
    return hasattr(message, "__float__")


def _joint_state(message: Any) -> SimpleNamespace | None:  # noqa: ANN401
    """A message with a JointState's fields, or with joints that have them, as a JointState."""
    names = getattr(message, "name", None)
    if names is not None and _is_list(names) and _is_list(getattr(message, "position", None)):
        lists = {f: _floats(getattr(message, f, ())) for f in _FIELDS}
        return SimpleNamespace(name=[str(n) for n in names], **lists)
    joints = getattr(message, "joints", None)
    if joints is None or not _is_list(joints) or not len(joints):
        return None
    if not all(hasattr(j, "name") and hasattr(j, "position") for j in joints):
        return None
    lists = {f: _floats([_given(j, f) for j in joints]) for f in _FIELDS}
    told = {f: x if any(v == v for v in x) else [] for f, x in lists.items()}
    return SimpleNamespace(name=[str(j.name) for j in joints], **told)


def _given(message: Any, field: str) -> object:  # noqa: ANN401
    """A field; None where Protobuf says that it was not set, if it can say so."""
    descriptor = getattr(message, "DESCRIPTOR", None)
    if descriptor is not None:
        known_field = descriptor.fields_by_name.get(field)
        if known_field is None or (known_field.has_presence and not message.HasField(field)):
            return None
    return getattr(message, field, None)


def _floats(values: Sequence[Any]) -> list[float]:
    return [float("nan") if v is None else float(v) for v in values]
