"""Ctrl-C in work that has something to say before it is done."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def twice(once: str, again: str) -> Iterator[Callable[[], bool]]:
    """Two Ctrl-C ask for an early end, and the third is one; yields whether the two have come.

    Args:
        once: line that the first prints: what the second would do.
        again: line that the second prints: what the third would do.
    """
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)
        if len(came) > 2:
            raise KeyboardInterrupt
        line = (once, again)[len(came) - 1]
        # print would fail where the signal came in the middle of another print
        os.write(sys.stderr.fileno(), f"\n{line}\n".encode())

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # interrupts come to the main thread only
        return
    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: len(came) > 1
    finally:
        signal.signal(signal.SIGINT, before)
