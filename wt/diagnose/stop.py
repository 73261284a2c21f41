"""An end of the search before its time: what is known by then is estimated, proven and written.

Whoever does not want to wait any longer asks for it. Only a search stops: a claim needs its proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.physics.runner import Divisible, Hypotheses, Runner, choose, chosen


class StoppedError(Exception):
    """A search is to end; it gives what it has."""


def _never() -> bool:
    return False


_asked: ContextVar[Callable[[], bool]] = ContextVar("stop", default=_never)


@contextmanager
def stop_when(asked: Callable[[], bool]) -> Iterator[None]:
    """Let searches of a block end once somebody has asked for it."""
    before = _asked.set(asked)
    try:
        yield
    finally:
        _asked.reset(before)


def stopped() -> bool:
    """Whether somebody has asked for the end."""
    return _asked.get()()


@dataclass(frozen=True)
class _Stoppable:
    """A runner that runs nothing once searches are to end."""

    runner: Runner

    def replay(
        self, replays: Divisible, hypotheses: Hypotheses
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """See :class:`Runner`."""
        if stopped():
            raise StoppedError
        return self.runner.replay(replays, hypotheses)


@contextmanager
def stoppable() -> Iterator[None]:
    """Let replays of a block raise :class:`StoppedError` once searches are to end."""
    with choose(_Stoppable(chosen())):
        yield
