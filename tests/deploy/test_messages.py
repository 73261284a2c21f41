"""Bytes and checksum of the messages, against cyclonedds' own serializer and the definition."""

from __future__ import annotations

import dataclasses
from typing import Any, get_type_hints

import numpy as np
import pytest
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import array

from deploy.idl import LowCmd_, LowState_
from deploy.messages import Packed, crc32

Kind = type[LowCmd_] | type[LowState_]
each_kind = pytest.mark.parametrize("kind", [LowCmd_, LowState_])


def by_definition(data: bytes) -> int:
    """CRC-32 with polynomial 0x04C11DB7, bit by bit, from the highest bit of each word."""
    crc = 0xFFFFFFFF
    for word in np.frombuffer(data, "<u4").tolist():
        for bit in range(31, -1, -1):
            top = (crc >> 31) ^ (word >> bit & 1)
            crc = crc << 1 & 0xFFFFFFFF ^ (0x04C11DB7 if top else 0)
    return crc


def fields_of(kind: type) -> dict[str, Any]:
    own = kind.__annotations__
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint for name, hint in hints.items() if name in own}


def plain(kind: type) -> type[IdlStruct]:
    """The same message as cyclonedds has them: one object per field."""
    fields = {}
    for name, hint in fields_of(kind).items():
        about = getattr(hint, "__metadata__", (None,))[0]
        if isinstance(hint, type):
            hint = plain(hint)
        elif isinstance(about, array) and isinstance(about.subtype, type):
            hint = array[plain(about.subtype), about.length]
        fields[name] = hint
    return make_idl_struct(kind.__name__, kind.__idl_typename__, fields)


def filled(kind: type[IdlStruct], record: np.void) -> IdlStruct:
    """A message of :func:`plain` with a record's values."""
    values = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        value, hint = record[field.name], field.type
        about = getattr(hint, "__metadata__", (None,))[0]
        if isinstance(hint, type):
            values[field.name] = filled(hint, value)
        elif isinstance(about, array) and isinstance(about.subtype, type):
            values[field.name] = [filled(about.subtype, v) for v in value]
        else:
            values[field.name] = value.tolist()
    return kind(**values)


def random(kind: Kind) -> LowCmd_ | LowState_:
    """A message whose every field has a value of its own."""
    rng = np.random.default_rng(0)
    message = kind(np.zeros((), kind.layout))

    def fill(record: np.ndarray) -> None:
        for name in record.dtype.names or ():
            part = record[name]
            if part.dtype.names:
                fill(part)
            elif part.dtype.kind == "f":
                record[name] = rng.normal(size=part.shape)
            else:
                info = np.iinfo(part.dtype)
                record[name] = rng.integers(info.min, info.max, part.shape, endpoint=True)

    fill(message.data)
    return message


@each_kind
def test_bytes_are_those_of_cyclonedds(kind: Kind) -> None:
    message, other = random(kind), plain(kind)
    expected = filled(other, message.data).serialize(use_version_2=False)
    assert message.serialize(use_version_2=False) == expected
    again = kind.deserialize(expected)
    assert again.data.tobytes() == message.data.tobytes()


@each_kind
def test_a_damaged_message_fails_its_checksum(kind: Kind) -> None:
    message = random(kind).seal()
    assert (
        int(message.data["crc"]) == message.checksum() == by_definition(message.data.tobytes()[:-4])
    )
    message.data["reserve"] ^= 1
    assert int(message.data["crc"]) != message.checksum()


def test_checksum_is_crc32_mpeg2() -> None:
    """The published check value of CRC-32/MPEG-2: 0x0376E6E7 of the nine bytes 123456789."""
    rng = np.random.default_rng(1)
    for words in (1, 2, 202, 294):
        data = rng.bytes(4 * words)
        assert crc32(data) == by_definition(data)
    # the ninth byte by hand, since a word has four: continue from the first eight
    crc = crc32(b"4321" + b"8765")  # words are read from their highest byte
    for bit in range(7, -1, -1):
        top = (crc >> 31) ^ (ord("9") >> bit & 1)
        crc = crc << 1 & 0xFFFFFFFF ^ (0x04C11DB7 if top else 0)
    assert crc == 0x0376E6E7


def test_layout_is_the_maker_s() -> None:
    """Sizes of the C structs under the SDK's checksum, and the names that DDS matches by."""
    assert (LowCmd_.layout.itemsize, LowState_.layout.itemsize) == (812, 1180)
    names = {kind.__idl_typename__ for kind in (LowCmd_, LowState_)}
    assert names == {"unitree_go.msg.dds_.LowCmd_", "unitree_go.msg.dds_.LowState_"}
    assert list(fields_of(LowCmd_)) == [
        "head", "level_flag", "frame_reserve", "sn", "version", "bandwidth", "motor_cmd",
        "bms_cmd", "wireless_remote", "led", "fan", "gpio", "reserve", "crc",
    ]  # fmt: skip
    assert issubclass(LowCmd_, Packed)
