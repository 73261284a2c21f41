"""The operator's remote control, as the 40 bytes in ``LowState.wireless_remote``.

Two bytes of head, two of buttons (one bit each), then five little-endian floats: left stick
sideways, right stick sideways, right stick forward, an unused axis, left stick forward.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

BUTTONS = (
    "R1", "L1", "start", "select", "R2", "L2", "F1", "F2",
    "A", "B", "X", "Y", "up", "right", "down", "left",
)  # fmt: skip
"""From the lowest bit to the highest."""

SIZE = 40
_FORMAT = struct.Struct("<2xH5f")


@dataclass(frozen=True, slots=True)
class Remote:
    """Buttons and sticks.

    Attributes:
        buttons: those that are held down, of :data:`BUTTONS`.
        forward: left stick, −1 … 1, away from the operator.
        left: the same stick to the left, −1 … 1.
        turn: right stick to the left, −1 … 1.
    """

    buttons: frozenset[str] = frozenset()
    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0

    @classmethod
    def unpack(cls, data: bytes) -> Remote:
        """Read :data:`SIZE` bytes; a stick that is no number rests."""
        bits, left_x, right_x, _right_y, _unused, left_y = _FORMAT.unpack_from(data)
        pressed = frozenset(name for k, name in enumerate(BUTTONS) if bits >> k & 1)
        # the sticks' x axis points right; robots' y axis and turning rate point left
        return cls(pressed, _stick(left_y), -_stick(left_x), -_stick(right_x))

    def pack(self) -> bytes:
        """The inverse of :meth:`unpack`."""
        bits = sum(1 << BUTTONS.index(name) for name in self.buttons)
        sticks = (-self.left, -self.turn, 0.0, 0.0, self.forward)
        return _FORMAT.pack(bits, *sticks).ljust(SIZE, b"\0")


def _stick(value: float) -> float:
    return min(1.0, max(-1.0, value)) if value == value else 0.0
