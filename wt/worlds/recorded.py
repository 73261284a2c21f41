"""What a world adds so that its R can be diagnosed: recordings, and S's description."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import mujoco

from wt.types import Domain, Recording


@runtime_checkable
class Recorded(Protocol):
    """A world whose R can be recorded, and whose S may be a model from a file (``model``)."""

    shard: int

    def record(self, count: int, seed: int, robots: int) -> list[Recording]:
        """What sensors would have recorded of R while ``collect("real", count, seed)`` went on.

        Args:
            count: of transitions.
            seed: of the collection.
            robots: how many recordings, one an episode.
        """
        ...

    def description(self, domain: Domain) -> mujoco.MjSpec:
        """A domain as its options describe it."""
        ...
