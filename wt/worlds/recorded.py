"""Contract of a world whose R can be diagnosed: recordings, and S's description."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import mujoco

from wt.types import Domain, Recording


@runtime_checkable
class Recorded(Protocol):
    """A world whose R can be recorded, and whose S may be a model from a file (``model``)."""

    shard: int

    def record(self, count: int, seed: int, robots: int) -> list[Recording]:
        """Recordings of R by its sensors while ``collect("real", count, seed)`` goes on.

        Args:
            count: of transitions.
            seed: of the collection.
            robots: number of recordings, one an episode.
        """
        ...

    def description(self, domain: Domain) -> mujoco.MjSpec:
        """A domain as its options describe it."""
        ...
