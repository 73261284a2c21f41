"""Time, so that a test can make it pass."""

from __future__ import annotations

import os
import time
from typing import Protocol, runtime_checkable

from wt.errors import ConfigError

_PRIORITY = 20  # of 1 to 99, above everything that has none


@runtime_checkable
class Clock(Protocol):
    """Time [s], from any beginning."""

    def now(self) -> float:
        """The time now."""

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


def take_precedence() -> None:
    """Have this process run before all ordinary ones, and all threads that it starts from now on.

    Raises:
        ConfigError: the system does not allow it, or has no such thing.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except (AttributeError, OSError) as error:
        raise ConfigError(
            f"--realtime: the system does not allow it ({error}); run as root, or allow it with: "
            "ulimit -r 20"
        ) from error
