"""Jobs side by side in processes of their own, which end with the run, however it ends.

Networks of this size gain little from several threads, and on a busy machine threads that wait
for one another lose much; so every job has one thread of torch's, and a process that it shares
with no other. Workers report through a queue and leave their results in the run's folder: one that
outlived the run would write into the folder that the resumed run works in.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

import torch

from wt.errors import WorkError
from wt.run.study import Listener
from wt.train.replicas import end_with_parent

J = TypeVar("J")
R = TypeVar("R")
Begin = Callable[[Listener, int], Callable[[J], R]]
"""Called once in each process, with what is told of progress and the process' index; gives what
does a job. It is sent to the processes: a top-level function, or a partial one."""

POLL_SECONDS = 0.2


def at_once(workers: int, jobs: int) -> int:
    """Number of processes for so many jobs.

    Args:
        workers: as configured; 0 for one per core.
        jobs: how many there are.
    """
    return min(workers or os.cpu_count() or 1, jobs)


def side_by_side(
    jobs: Sequence[J],
    workers: int,
    begin: Begin[J, R],
    listener: Listener,
    ended: Callable[[J, Future[R]], None],
    *,
    grace: float = 0.0,
) -> None:
    """Do all jobs, so many at once; a single worker is this process.

    Args:
        jobs: longest first, so that no core waits for a last long one.
        workers: as in :func:`at_once`.
        begin: opens what a process works with.
        listener: told of progress.
        ended: told of each job that has ended, in this process: the future has what it gave or
            raised. What this raises ends all.
        grace: when all are ended, so long may jobs that run take to put away what they have [s]:
            each gets a KeyboardInterrupt. At 0 they are killed.

    Raises:
        WorkError: a worker was killed from outside.
    """
    workers = at_once(workers, len(jobs))
    if workers <= 1:
        _one_by_one(jobs, begin, listener, ended)
        return
    context = multiprocessing.get_context("spawn")
    messages, places = context.Queue(), context.Queue()
    for index in range(workers):
        places.put(index)
    arguments = (begin, messages, places, grace > 0)
    with ProcessPoolExecutor(workers, context, _open, arguments) as pool, _ended_on_error(grace):
        with _deaf_to_interrupts():
            pending = {_submit(pool, job): job for job in jobs}
        while pending:
            _hand_on(messages, listener)
            for future in wait(pending, timeout=0).done:
                if isinstance(future.exception(), BrokenProcessPool):
                    future.result()
                ended(pending.pop(future), future)
        _hand_on(messages, listener)


def _one_by_one(
    jobs: Sequence[J],
    begin: Begin[J, R],
    listener: Listener,
    ended: Callable[[J, Future[R]], None],
) -> None:
    torch.set_num_threads(1)
    do = begin(listener, 0) if jobs else None
    for job in jobs:
        assert do is not None
        future: Future[R] = Future()
        try:
            future.set_result(do(job))
        except Exception as error:
            future.set_exception(error)
        try:
            ended(job, future)
        except BaseException as error:
            # it would hold itself by the future, and so what its frames have open, until some
            # garbage collection
            traceback.clear_frames(error.__traceback__)
            raise
        finally:
            del future


def _submit(pool: ProcessPoolExecutor, job: Any) -> Future[Any]:  # noqa: ANN401 – any job
    """Give a job to the pool, which starts a worker for it where one is missing."""
    try:
        return pool.submit(_do, job)
    except OSError:
        # perhaps another worker has died, and the pool closed the pipes this one was to inherit
        pool.submit(_do, job)  # then it says so now: BrokenProcessPool
        raise


class _Sender:
    """The listener inside a worker: everything goes through the queue."""

    def __init__(self, messages: Any) -> None:  # noqa: ANN401 – a queue of a spawn context
        self._messages = messages

    def progress(self, what: str, done: int, total: int) -> None:
        self._messages.put(("progress", (what, done, total)))

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        self._messages.put(("metrics", (what, dict(values), step)))

    def warn(self, line: str) -> None:
        self._messages.put(("warn", (line,)))


_begun: list[Callable[[Any], Any]] = []
"""What does the jobs of this worker process; filled once by ``_open``."""
_working = threading.Event()
"""Set while this worker process does a job."""


def _open(begin: Begin[Any, Any], messages: Any, places: Any, gently: bool) -> None:  # noqa: ANN401 – see _Sender
    end_with_parent()
    torch.set_num_threads(1)
    if gently:
        signal.signal(signal.SIGTERM, _interrupt)
    _begun.append(begin(_Sender(messages), places.get()))


def _interrupt(number: int, frame: object) -> None:
    if not _working.is_set():
        os._exit(1)  # there is nothing to put away
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the pool says it again once a worker is gone
    raise KeyboardInterrupt


def _do(job: Any) -> Any:  # noqa: ANN401 – any job
    try:
        _working.set()
        try:
            return _begun[0](job)
        finally:
            _working.clear()
    except KeyboardInterrupt:
        os._exit(1)  # what there is has been put away, and no further job is to begin


@contextmanager
def _ended_on_error(grace: float) -> Iterator[None]:
    """End all workers at once when something goes wrong; checkpoints are whole at any moment."""
    try:
        yield
    except BaseException as error:
        _end(multiprocessing.active_children(), grace)
        if isinstance(error, BrokenProcessPool):
            raise WorkError(
                "a training process was killed from outside, perhaps for want of memory; "
                "continue with --resume, and with workers=1 if it happens again"
            ) from error
        raise


def _end(workers: Sequence[multiprocessing.process.BaseProcess], grace: float) -> None:
    try:
        if grace > 0:
            for worker in workers:
                worker.terminate()
            end = time.monotonic() + grace
            for worker in workers:
                worker.join(max(0.0, end - time.monotonic()))
    finally:
        for worker in workers:
            worker.kill()  # while it trains, Lightning would only take note of a SIGTERM


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started inside never see Ctrl-C: it is for the parent, which ends them.

    Blocked here and inherited, since a process that only ignored it once it is up would die with
    a traceback while it is still importing.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _hand_on(messages: Any, listener: Listener) -> None:  # noqa: ANN401 – see _Sender
    """Pass on the messages of workers, waiting a moment for the next."""
    try:
        while True:
            kind, arguments = messages.get(timeout=POLL_SECONDS)
            getattr(listener, kind)(*arguments)
    except queue.Empty:
        return
