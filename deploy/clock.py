"""Time, so that a test can make it pass."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable


@runtime_checkable
class Clock(Protocol):
    """Time [s], from any beginning."""

    def now(self) -> float:
        """What time it is."""

    def sleep_until(self, then: float) -> None:
        """Return at that time; at once, if it has passed."""


class Monotonic:
    """The machine's own clock, which processes on it share."""

    def now(self) -> float:
        """As :class:`Clock`."""
        return time.monotonic()

    def sleep_until(self, then: float) -> None:
        """As :class:`Clock`."""
        if (left := then - time.monotonic()) > 0:
            time.sleep(left)
