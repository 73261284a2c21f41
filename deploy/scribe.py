"""A process that keeps what the runner records, so that the runner may be killed at any time.

The runner hands every tick to it through a pipe, which costs microseconds and never waits. If the
pipe closes before the runner has written its own files, the scribe writes them: the recording up to
the last tick. It is in a session of its own, so that what ends the runner spares it.
"""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from deploy.record import Recorder

_PIPE = 1 << 20  # bytes: more than three seconds of ticks


class Scribe:
    """The runner's end of the pipe."""

    def __init__(self, folder: Path, recorder: Recorder, meta: dict[str, object]) -> None:
        """Start the process and let it follow a recorder.

        Args:
            folder: where it would write.
            recorder: whose rows it keeps.
            meta: free metadata of both files.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-m", "deploy.scribe", str(folder)],
            stdin=subprocess.PIPE, start_new_session=True,
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
        except BrokenPipeError:  # nobody is there to keep it
            self._waiting.clear()

    def dismiss(self) -> None:
        """The runner has written its own files."""
        self._process.kill()
        self._process.wait()


def main(folder: Path) -> None:
    """Read until the pipe closes, then write.

    Args:
        folder: where to.
    """
    header = json.loads(sys.stdin.buffer.readline())
    rows = np.frombuffer(_whole_rows(len(header["columns"]["log"])))
    recorder = Recorder.restored(header["columns"], rows.reshape(-1, len(header["columns"]["log"])))
    recorder.write(folder, {**header["meta"], "killed": True})


def _whole_rows(columns: int) -> bytes:
    content = sys.stdin.buffer.read()
    return content[: len(content) - len(content) % (8 * columns)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
