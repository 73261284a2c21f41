"""Jobs: one process each, so that whatever a file does to its parser ends that job alone.

A process is forked from one that has loaded what works need, so that it starts at once. It tells
what it does in JSON, never in pickles: what a file could make it say cannot run here.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import multiprocessing
import os
import signal
import threading
import time
from dataclasses import dataclass, field
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal

from wt.errors import WTError

State = Literal["running", "done", "failed", "stopped"]
_LONGEST = 2**28  # bytes of one message: figures of many channels


@dataclass(eq=False)
class Job:
    """A work that was started.

    Attributes:
        work: its name.
        state: how it stands.
        told: the last of each thing that it told: ``step``, ``share``, ….
        result: what it gave, if it is done.
        line: why it failed.
        began: on the clock of :func:`time.monotonic` [s].
        seconds: that it took, once it ended.
        commands: that do the same.
        reads: files that it needs until its end.
    """

    work: str
    state: State = "running"
    told: dict[str, Any] = field(default_factory=dict)
    result: Any = None
    line: str = ""
    began: float = field(default_factory=time.monotonic)
    seconds: float = 0.0
    commands: list[str] = field(default_factory=list)
    reads: tuple[str, ...] = ()
    _process: Any = None
    _thread: threading.Thread | None = None

    def wait(self, timeout: float | None = None) -> None:
        """Wait for the end [s]."""
        if self._thread is not None:
            self._thread.join(timeout)

    def stop(self) -> None:
        """End it, if it runs."""
        if self.state == "running":
            self.seconds = time.monotonic() - self.began  # before anybody asks for it
            self.state = "stopped"
            self._process.terminate()
        self.wait(5.0)

    @property
    def running(self) -> bool:
        """Tell whether it is not over."""
        return self.state == "running"

    @property
    def elapsed(self) -> float:
        """Time since it began, or that it took [s]."""
        return time.monotonic() - self.began if self.running else self.seconds


class Jobs:
    """Starts jobs in a folder; one of each work at a time."""

    def __init__(self, folder: Path) -> None:
        """Have the parent of all jobs started, which takes seconds.

        Args:
            folder: in which they work.
        """
        self._folder = folder
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["wt.studio.work"])
        forkserver.ensure_running()  # loads while the page is opened
        self._latest: dict[str, Job] = {}
        self._lock = threading.Lock()

    def start(self, work: str, **arguments: object) -> Job:
        """Start a work; an earlier one of this kind is stopped.

        Args:
            work: a name of :data:`wt.studio.work.WORKS`.
            arguments: of it, as JSON can say them.
        """
        with self._lock:
            if before := self._latest.get(work):
                before.stop()
            ours, theirs = self._context.Pipe(duplex=False)
            target = (theirs, str(self._folder), work, json.dumps(arguments))
            process = self._context.Process(target=_run, args=target, daemon=True)
            job = Job(work, _process=process)
            process.start()
            theirs.close()
            job._thread = threading.Thread(target=_listen, args=(job, ours), daemon=True)
            job._thread.start()
            self._latest[work] = job
            return job

    def latest(self, work: str) -> Job | None:
        """The last job of a work, if there was one."""
        return self._latest.get(work)

    def stop(self) -> None:
        """End all that run."""
        for job in self._latest.values():
            job.stop()


def _listen(job: Job, connection: Connection) -> None:
    """Take note of what a job tells until it ends."""
    ended: dict[str, Any] = {}
    with connection, contextlib.suppress(EOFError, OSError, ValueError):
        while not ended:
            message = json.loads(connection.recv_bytes(_LONGEST))
            if "result" in message or "error" in message:
                ended = message
            else:
                job.told.update(message)
    job._process.join()
    if job.state == "stopped":
        return
    job.seconds = time.monotonic() - job.began
    if "result" in ended:
        job.result, job.state = ended["result"], "done"
    else:
        job.line, job.state = ended.get("error") or _died(job), "failed"


def _died(job: Job) -> str:
    code = job._process.exitcode
    how = f"by {signal.Signals(-code).name}" if code and code < 0 else f"with code {code}"
    what = job.told.get("step", job.work)
    return f"the process ended {how} while {what}: a file that it was reading may be broken"


def _run(connection: Connection, folder: str, work: str, arguments: str) -> None:
    """Do a work in this process, which is a new one."""
    os.chdir(folder)  # files have the names that commands in this folder would give them
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server's Ctrl-C, which ends this too

    def send(message: dict[str, Any]) -> None:
        connection.send_bytes(json.dumps(message).encode())

    try:
        works = importlib.import_module("wt.studio.work").WORKS
        send({"result": works[work](send, **json.loads(arguments))})
    except WTError as error:
        send({"error": str(error)})
    except MemoryError:
        send({"error": "not enough memory for these files; cut them, or thin them out"})
    except Exception as error:  # whatever a file does, it is a line
        send({"error": f"unexpected {type(error).__name__}: {' '.join(str(error).split())}"})
