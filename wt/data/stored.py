"""Transitions that stay on disk, for collections that memory does not hold.

Parquet divides a shard into row groups, of which each can be read by itself. A footer says how long
they are, so that opening a collection reads none of its transitions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wt.data.transitions import groups_of, join, read
from wt.errors import DataError
from wt.types import Pairs, Transitions, TransitionSpec

MOST = 10_000
"""Transitions of either domain that are held out at most: more would score no better."""


def held_out(transitions: int, share: float) -> int:
    """Number of transitions that are not trained on, at most, of so many and such a share."""
    return min(MOST, max(1, int(share * transitions)))


class RowGroup(NamedTuple):
    """A row group of a shard.

    Attributes:
        path: the shard.
        number: of the row group in it.
        rows: how many of its transitions count, from the first on.
    """

    path: Path
    number: int
    rows: int


@dataclass(frozen=True)
class Stored:
    """Transitions of one domain on disk.

    Attributes:
        spec: layout of the transitions.
        groups: where they are, in order.
    """

    spec: TransitionSpec
    groups: tuple[RowGroup, ...]

    @classmethod
    def of(cls, shards: Sequence[Path], spec: TransitionSpec) -> Stored:
        """The transitions of a collection.

        Args:
            shards: its files, in order.
            spec: layout of the transitions.

        Raises:
            DataError: a shard is truncated.
        """
        groups = [RowGroup(p, i, n) for p in shards for i, n in enumerate(groups_of(p)) if n]
        return cls(spec, tuple(groups))

    def __len__(self) -> int:
        """Number of transitions."""
        return sum(group.rows for group in self.groups)

    @property
    def largest(self) -> int:
        """Transitions of the largest row group."""
        return max(group.rows for group in self.groups)

    def read(self, group: int) -> Transitions:
        """The transitions of one row group, by its place in :attr:`groups`.

        Raises:
            DataError: its shard is damaged, or of another layout.
        """
        path, number, rows = self.groups[group]
        data = transitions(read(path, self.spec, number))
        return data if len(data) == rows else data.select(np.arange(rows))

    def parts(self) -> Iterator[Transitions]:
        """All transitions, a row group at a time."""
        return (self.read(group) for group in range(len(self.groups)))

    def sample(self, most: int) -> Transitions:
        """As many row groups, evenly spread, as have at most so many transitions together.

        At least a part of one. Where a row group ends, so does the episode that is under way.
        """
        count = min(len(self.groups), max(1, most // self.largest))
        spread = [k * len(self.groups) // count for k in range(count)]
        data = self._joined(spread)
        return data if len(data) <= most else data.select(np.arange(most))

    def last(self, least: int) -> Transitions:
        """The last row groups that have at least so many transitions together."""
        first, rows = len(self.groups), 0
        while first and rows < least:
            first -= 1
            rows += self.groups[first].rows
        return self._joined(range(first, len(self.groups)))

    def without_last(self, rows: int) -> Stored:
        """All transitions but the last ones."""
        groups = list(self.groups)
        while groups and rows >= groups[-1].rows:
            rows -= groups.pop().rows
        if groups and rows:
            groups[-1] = groups[-1]._replace(rows=groups[-1].rows - rows)
        return replace(self, groups=tuple(groups))

    def _joined(self, groups: Sequence[int]) -> Transitions:
        return transitions(join([self.read(group) for group in groups]))


class Streams(NamedTuple):
    """Collections that training streams, since memory holds a sample of them only.

    Attributes:
        sim: of S; None where memory holds all of it.
        real: of R, likewise.
        in_memory: transitions of either that memory holds at most.
    """

    sim: Stored | None = None
    real: Stored | None = None
    in_memory: int = 0


def transitions(collection: Transitions | Pairs) -> Transitions:
    """A collection, or a part of it, that has to be one of transitions.

    Raises:
        DataError: it is one of pairs.
    """
    if isinstance(collection, Transitions):
        return collection
    raise DataError("a collection of pairs lies where transitions belong; delete that folder")
