"""Runners of replays, and the one that runs them now.

A :class:`~wt.physics.rollout.Replayer` asks the chosen runner, which runs it in parts. So it knows
nothing of clusters, and :mod:`wt.physics.spread` is free to choose any.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.scene import Scene

Hypotheses = Sequence[Sequence[Planted]]


@runtime_checkable
class Divisible(Protocol):
    """Replays that can be run in parts; a :class:`~wt.physics.rollout.Replayer`.

    Attributes:
        scene: the machine.
        stretches: what is replayed.
        step: physics step [s].
    """

    scene: Scene
    stretches: tuple[Stretch, ...]
    step: float

    def part(
        self, hypotheses: Hypotheses, stretches: Sequence[int], threads: int
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """Some stretches on some hypotheses in this process: positions and velocities."""


@runtime_checkable
class Runner(Protocol):
    """Runs replays."""

    def replay(
        self, replays: Divisible, hypotheses: Hypotheses
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """Every stretch on every hypothesis: positions and velocities."""


@dataclass(frozen=True)
class Threads:
    """This process.

    Attributes:
        count: how many threads; 0 for one a core.
    """

    count: int = 0

    def replay(
        self, replays: Divisible, hypotheses: Hypotheses
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """See :class:`Runner`."""
        return replays.part(hypotheses, range(len(replays.stretches)), self.count)


def split(hypotheses: int, stretches: int, cores: int) -> list[tuple[slice, range]]:
    """Divide hypotheses × stretches into about as many parts as there are cores.

    Hypotheses are dealt like cards, for neighbours are alike and take equally long. Only if they
    are fewer than cores, stretches are divided too: a model is compiled once in each part.
    """
    piles = max(1, min(hypotheses, cores))
    runs = min(stretches, -(-cores // piles))
    edges = [stretches * i // runs for i in range(runs + 1)]
    return [
        (slice(pile, None, piles), range(first, last))
        for pile in range(piles)
        for first, last in itertools.pairwise(edges)
    ]


def joined(
    replays: Divisible,
    hypotheses: int,
    parts: Iterable[tuple[slice, range]],
    said: Iterable[Float[np.ndarray, "2 _ _ dof"]],
) -> Float[np.ndarray, "2 hypothesis sample dof"]:
    """What all parts said, as :func:`split` has divided so many hypotheses and all stretches."""
    ends = np.cumsum([0, *(len(s.t) for s in replays.stretches)])
    path = np.empty((2, hypotheses, int(ends[-1]), replays.scene.model.nv))
    for (h, s), part in zip(parts, said, strict=True):
        path[:, h, ends[s.start] : ends[s.stop]] = part
    return path


_EVERY_CORE = Threads()
_chosen: ContextVar[Runner] = ContextVar("runner", default=_EVERY_CORE)


def chosen() -> Runner:
    """The runner of the moment."""
    return _chosen.get()


@contextmanager
def choose(runner: Runner) -> Iterator[None]:
    """Let a runner run all replays of a block."""
    before = _chosen.set(runner)
    try:
        yield
    finally:
        _chosen.reset(before)
