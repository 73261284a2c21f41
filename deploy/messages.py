"""Messages as bytes: from the fields of :mod:`deploy.idl` to what DDS carries, and the checksum.

A message is one NumPy record, :attr:`Packed.data`, and not an object per field: cyclonedds'
own field-by-field serializer takes as long as a whole tick of the control loop may. The record has
the layout of the maker's C struct, over which the checksum runs. On the wire (CDR) an inner struct
has no padding at its end, which moves a few bytes; :func:`_wire` knows which.
"""

import zlib
from collections.abc import Iterator
from typing import Any, ClassVar, TypeVar, get_type_hints

import numpy as np
from cyclonedds.idl.types import array

P = TypeVar("P", bound="Packed")

_HEADER = b"\0\1\0\0"  # plain CDR, little-endian
_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def crc32(data: bytes) -> int:
    """Unitree's checksum: CRC-32/MPEG-2 over little-endian words, most significant bit first.

    That is polynomial 0x04C11DB7, start 0xFFFFFFFF, nothing mirrored, nothing inverted at the end.
    zlib's CRC-32 has the same polynomial and start, but mirrors every byte and the result, and
    inverts the result: undone here, since zlib is some hundred times faster than a loop in Python.

    Args:
        data: a whole number of 32-bit words.
    """
    words = np.frombuffer(data, "<u4").astype(">u4").tobytes()
    mirrored = zlib.crc32(words.translate(_MIRRORED)) ^ 0xFFFFFFFF
    return int.from_bytes(mirrored.to_bytes(4, "little").translate(_MIRRORED), "big")


def _layout(message: type) -> np.dtype:
    """The C struct of a message."""
    hints = get_type_hints(message, include_extras=True)
    fields: list[Any] = []
    for name, hint in hints.items():
        if name in message.__annotations__ and not name.startswith("_"):
            about = getattr(hint, "__metadata__", (None,))[0]
            if isinstance(about, array):
                fields.append((name, _element(about.subtype), (about.length,)))
            else:
                fields.append((name, _element(hint)))
    return np.dtype(fields, align=True)


def _element(hint: Any) -> np.dtype:  # noqa: ANN401 – whatever an annotation may be
    return _layout(hint) if isinstance(hint, type) else np.dtype(hint.__metadata__[0])


def _wire(layout: np.dtype) -> tuple[np.ndarray, np.ndarray]:
    """For each byte on the wire: which byte of the C struct it is, and whether it is one at all."""
    index: list[int] = []
    for offset, size, count in _leaves(layout, 0):
        index += [-1] * (-len(index) % size)
        index += range(offset, offset + size * count)
    order = np.array(index)
    return order, order >= 0


def _leaves(layout: np.dtype, start: int) -> Iterator[tuple[int, int, int]]:
    """Offset, size of an element and number of elements of each field that is no struct."""
    for name in layout.names or ():
        kind, offset = layout.fields[name][:2]  # type: ignore[index]
        base, shape = kind.subdtype or (kind, (1,))
        if base.names is None:
            yield start + offset, base.itemsize, shape[0]
        else:
            for k in range(shape[0]):
                yield from _leaves(base, start + offset + k * base.itemsize)


class Packed:
    """A message as one record.

    Attributes:
        data: the fields, a zero-dimensional structured array in the layout of the C struct.
        layout: its dtype.
    """

    layout: ClassVar[np.dtype]
    _index: ClassVar[np.ndarray]
    _is_field: ClassVar[np.ndarray]

    def __init_subclass__(cls, **_: object) -> None:
        """Derive the bytes from the annotations."""
        super().__init_subclass__()
        # The IDL's base must be the first, and would have its own way to make bytes.
        for name in ("serialize", "deserialize", "deserialize_key"):
            setattr(cls, name, Packed.__dict__[name])
        cls.layout = _layout(cls)
        cls._index, cls._is_field = _wire(cls.layout)

    def __init__(self, data: np.ndarray | None = None) -> None:
        """A message with the given fields, or with all of them zero."""
        self.data = np.zeros((), self.layout) if data is None else data

    def serialize(self, *_: object, **__: object) -> bytes:
        """As it travels: header and little-endian CDR; called by cyclonedds."""
        raw = np.frombuffer(self.data.tobytes(), np.uint8)
        return _HEADER + np.where(self._is_field, raw[self._index], 0).astype(np.uint8).tobytes()

    @classmethod
    def deserialize(cls: type[P], data: bytes, *_: object, **__: object) -> P:
        """From what :meth:`serialize` made, here or on the robot; called by cyclonedds."""
        raw = np.zeros(cls.layout.itemsize, np.uint8)
        wire = np.frombuffer(data, np.uint8, len(cls._index), offset=len(_HEADER))
        raw[cls._index[cls._is_field]] = wire[cls._is_field]
        return cls(raw.view(cls.layout)[0:1].reshape(()))

    @classmethod
    def deserialize_key(cls: type[P], *_: object, **__: object) -> P:
        """Message of a writer that leaves: none; called by cyclonedds."""
        return cls()

    def seal(self: P) -> P:
        """Set ``crc`` to the checksum of the fields before it."""
        self.data["crc"] = self.checksum()
        return self

    def checksum(self) -> int:
        """The value that ``crc``, the last field, must have."""
        return crc32(self.data.tobytes()[:-4])
