"""A choice of where replays run: on the cores of this machine, or spread over a Ray cluster.

``with over("ray"):`` holds for every :class:`~wt.physics.rollout.Replayer` that is run inside, and
changes no bit of what they say: each replay is computed by itself, wherever that is. (Machines of
a cluster whose processors differ may round a sine differently.)
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from wt.errors import UserError
from wt.physics.cluster import cluster
from wt.physics.runner import Runner, Threads, choose
from wt.physics.workers import workers


@contextmanager
def over(jobs: int | str | None) -> Iterator[None]:
    """Choose where the replays inside run.

    Args:
        jobs: number of cores, ``"ray"`` for a Ray cluster (that of ``RAY_ADDRESS``; without it
            one of this machine's cores, which ends with the block), or None for all of them.

    Raises:
        UserError: it is none of these, or the cluster cannot be used.
        WorkError: Ray is not installed.
    """
    with _opened(jobs) as runner, choose(runner):
        yield


def _opened(jobs: int | str | None) -> AbstractContextManager[Runner]:
    if jobs == "ray":
        return cluster()
    count = str(cores() if jobs is None else jobs)
    if not count.isdecimal() or int(count) < 1:
        raise UserError(f"jobs {jobs!r}: give a number of cores from 1 up, or 'ray'")
    return nullcontext(Threads(1)) if int(count) == 1 else workers(int(count))


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
