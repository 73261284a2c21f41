"""MuJoCo's warnings off while replays are expected to explode."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

_COMPILED_BY = r"wt\.physics\.(rollout|parts|hits)$"
"""Modules that compile models of hypotheses."""
_lock = threading.Lock()
_inside: list[mujoco.MjLogConfig] = []
"""Settings to go back to, one for each block entered: only the first is the caller's own."""


@contextmanager
def quiet() -> Iterator[None]:
    """Neither print MuJoCo's warnings nor write them to ``MUJOCO_LOG.TXT``.

    The switch is the process's, so it holds in the threads of ``mujoco.batch`` too; the last to
    leave puts it back. Warnings are counted all the same (``Batch.warning``), errors still raise.
    What it says of hypotheses as it compiles them is Python's, and is not told from then on.
    """
    warnings.filterwarnings("ignore", category=UserWarning, module=_COMPILED_BY)
    with _lock:
        config = mujoco.MjLogConfig.get()
        _inside.append(_inside[0] if _inside else mujoco.MjLogConfig.get())
        config.logto_console = config.logto_file = False
        config.set()
    try:
        yield
    finally:
        with _lock:
            before = _inside.pop()
            if not _inside:
                before.set()
