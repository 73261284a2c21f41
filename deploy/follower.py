"""A process beside the runner that is told every tick, through a pipe.

Telling it costs microseconds and never waits; a process that is behind finds what it missed in the
pipe. It gives way to the runner, and is in a session of its own, so that what ends the runner
spares it.
"""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from io import BufferedReader
from typing import Any

import numpy as np

from deploy.record import Recorder

_PIPE = 1 << 20  # bytes: more than three seconds of ticks
_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
"""A matrix that is inverted on all cores would take the runner's too."""


class Follower:
    """The runner's end of the pipe."""

    def __init__(
        self, module: str, words: Sequence[str], recorder: Recorder, meta: Mapping[str, object],
    ) -> None:  # fmt: skip
        """Start the process and let it follow a recorder.

        Args:
            module: what it runs.
            words: its arguments.
            recorder: whose rows it is told.
            meta: free metadata, for its header.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            start_new_session=True, env=os.environ | _ONE_THREAD,
        )  # fmt: skip
        with suppress(OSError):  # the runner may go before all else, this need not
            os.sched_setscheduler(self._process.pid, os.SCHED_OTHER, os.sched_param(0))
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        with suppress(AttributeError, OSError):  # only Linux has it, up to a limit
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE)
        header = {"columns": recorder.columns, "meta": meta}
        os.write(self._pipe, json.dumps(header, default=str).encode() + b"\n")
        os.set_blocking(self._pipe, False)
        self._waiting = bytearray()
        recorder.follow(self._take)

    def _take(self, row: np.ndarray) -> None:
        """Pass a row on, with those before it that did not fit."""
        self._waiting += row.tobytes()
        try:
            del self._waiting[: os.write(self._pipe, self._waiting)]
        except BlockingIOError:
            pass
        except BrokenPipeError:  # nobody is there to be told
            self._waiting.clear()

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    def await_ready(self) -> None:
        """Wait until the process says that it is :func:`ready`, or ends."""
        assert self._process.stdout is not None
        self._process.stdout.readline()

    def dismiss(self) -> None:
        """End the process: the runner has done what it would do."""
        self._process.kill()
        self._process.wait()


def ready() -> None:
    """Work only where nobody else does from now, and say that what takes time at first is done."""
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    print("ready", flush=True)


def told() -> BufferedReader:
    """The process's end of the pipe."""
    assert isinstance(sys.stdin.buffer, BufferedReader)
    return sys.stdin.buffer


def header(stream: BufferedReader) -> dict[str, Any]:
    """``columns`` of the recorder and ``meta``, at the process's end of the pipe."""
    said: dict[str, Any] = json.loads(stream.readline())
    return said


def rows(stream: BufferedReader, columns: int) -> Iterator[np.ndarray]:
    """Rows of the log as they come, (N, columns); ends when the runner is gone."""
    size, rest = 8 * columns, b""
    while content := stream.read1(_PIPE):
        rest += content
        whole = len(rest) - len(rest) % size
        if whole:
            yield np.frombuffer(rest[:whole]).reshape(-1, columns)
            rest = rest[whole:]
