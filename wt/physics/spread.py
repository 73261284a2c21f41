"""Where replays run: on threads of this process, or spread over a Ray cluster.

``with over("ray"):`` holds for every :class:`~wt.physics.rollout.Replayer` that is run inside, and
changes no bit of what they say: each replay is computed by itself, wherever that is. (Machines of
a cluster whose processors differ may round a sine differently.)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from wt.errors import UserError

if TYPE_CHECKING:
    from wt.physics.replay import Planted
    from wt.physics.rollout import Replayer

Array = np.ndarray


@runtime_checkable
class Spread(Protocol):
    """Runs replays."""

    def replay(self, replayer: Replayer, hypotheses: Sequence[Sequence[Planted]]) -> Array:
        """Every stretch on every hypothesis: positions and velocities, (2, H, N, nv)."""


@dataclass(frozen=True)
class Threads:
    """This process.

    Attributes:
        count: how many threads; 0 for one a core.
    """

    count: int = 0

    def replay(self, replayer: Replayer, hypotheses: Sequence[Sequence[Planted]]) -> Array:
        """See :class:`Spread`."""
        return replayer.part(hypotheses, range(len(replayer.stretches)), self.count)


_EVERY_CORE = Threads()
_chosen: ContextVar[Spread] = ContextVar("spread", default=_EVERY_CORE)


def chosen() -> Spread:
    """Where replays run now."""
    return _chosen.get()


@contextmanager
def over(jobs: int | str | None) -> Iterator[None]:
    """Choose where the replays inside run.

    Args:
        jobs: number of threads, ``"ray"`` for a Ray cluster (that of ``RAY_ADDRESS``; without it
            one of this machine's cores, which ends with the block), or None for one thread a core.

    Raises:
        UserError: it is none of these, Ray is not installed, or its cluster cannot be used.
    """
    with _opened(jobs) as spread:
        before = _chosen.set(spread)
        try:
            yield
        finally:
            _chosen.reset(before)


def _opened(jobs: int | str | None) -> AbstractContextManager[Spread]:
    if jobs == "ray":
        from wt.physics.cluster import cluster

        return cluster()
    count = str(0 if jobs is None else jobs)
    if not count.isdecimal() or (jobs is not None and int(count) < 1):
        raise UserError(f"jobs {jobs!r}: give a number of threads from 1 up, or 'ray'")
    return nullcontext(Threads(int(count)))
