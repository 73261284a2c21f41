"""Where collections are made: in this process, or shard by shard on a Ray cluster.

Nodes are given the world itself, with all files that it was made of, and give transitions back:
only the caller writes. So a shard is made once, whole or not at all, and says the same wherever it
is made. (Machines of a cluster whose processors differ may round a sine differently.)
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from wt.cluster import called_off, connected, cores, same_versions, versions
from wt.config import Jobs
from wt.data.transitions import Made, Shard
from wt.types import Domain, Pairs, Transitions
from wt.worlds.base import Progress, World, kind_of, make
from wt.worlds.varied import Varied

if TYPE_CHECKING:
    from ray import ObjectRef

ASKED_BY = "collect.jobs=ray"
"""What asks for Ray, for messages."""

LESSONS = "lessons"
"""The collection of simulators around S, of worlds that can vary it."""

Report = Callable[[str, int, int], None]
"""Called with a collection's name and its transitions (done, total)."""


@runtime_checkable
class Maker(Protocol):
    """Makes shards of a world's collections."""

    def made(self, what: str, shards: Sequence[Shard], report: Report | None) -> Iterator[Made]:
        """Shards with their content, in any order.

        Args:
            what: ``"sim"``, ``"real"`` or :data:`LESSONS` for transitions, a split for pairs.
            shards: those that are missing.
            report: told of the transitions of these shards.
        """
        ...


class Here:
    """One shard after the other, in this process."""

    def __init__(self, world: World) -> None:
        """Make what this world collects."""
        self._world = world

    def made(self, what: str, shards: Sequence[Shard], report: Report | None) -> Iterator[Made]:
        """See :class:`Maker`."""
        total, done = sum(shard.count for shard in shards), 0
        for shard in shards:

            def progress(now: int, _: int, before: int = done) -> None:
                if report:
                    report(what, before + now, total)

            yield shard, _made(self._world, what, shard, progress)
            done += shard.count


class OnRay:
    """On all cores of a Ray cluster, which is asked for when the first shard is missing."""

    def __init__(self, section: Mapping[str, Any], opened: ExitStack) -> None:
        """Make what the world of a configuration's ``world:`` section collects.

        Args:
            section: ``name`` and the options of the world.
            opened: where the cluster is left.
        """
        options = {field.name for field in fields(kind_of(section).options)}
        # a task has one core
        self._section = {**section, "threads": 1} if "threads" in options else section
        self._opened = opened
        self._world: ObjectRef | None = None

    def made(self, what: str, shards: Sequence[Shard], report: Report | None) -> Iterator[Made]:
        """See :class:`Maker`."""
        if not shards:
            return
        world, total, done = self._put(), sum(shard.count for shard in shards), 0
        import ray

        task, waiting = ray.remote(_task), list(shards)
        most = 2 * cores()  # so that no core waits while shards are written here
        pending: dict[ObjectRef, Shard] = {}
        with called_off(pending):
            while waiting or pending:
                while waiting and len(pending) < most:
                    shard = waiting.pop(0)
                    # in a list Ray hands on the reference, not the thing
                    pending[task.remote(versions(), [world], what, shard)] = shard
                (ready, *_), _ = ray.wait(list(pending), num_returns=1)
                content = ray.get(ready)
                shard = pending.pop(ready)
                yield shard, content
                done += shard.count
                if report:
                    report(what, done, total)

    def _put(self) -> ObjectRef:
        if self._world is None:
            self._opened.enter_context(connected(ASKED_BY))
            import ray

            self._world = ray.put(make(self._section))
        return self._world


@contextmanager
def spread(jobs: Jobs, section: Mapping[str, Any], world: World) -> Iterator[Maker]:
    """What makes shards as ``collect.jobs`` says, for the block.

    Args:
        jobs: ``"here"``, or ``"ray"`` for a Ray cluster (that of ``RAY_ADDRESS``; without it one of
            this machine's cores, which ends with the block).
        section: a configuration's ``world:`` section.
        world: what it describes.
    """
    with ExitStack() as opened:
        yield OnRay(section, opened) if jobs == "ray" else Here(world)


def _made(
    world: World, what: str, shard: Shard, progress: Progress | None = None
) -> Transitions | Pairs:
    if what in ("sim", "real"):
        domain: Domain = "sim" if what == "sim" else "real"
        return world.collect(domain, shard.count, shard.seed, progress)
    if what == LESSONS:
        assert isinstance(world, Varied), "lessons are planned of no other world"
        return world.lessons(shard.count, shard.seed, progress)
    return world.pairs(what, shard.count, shard.seed)


# -- in a worker -----------------------------------------------------------------------------------


def _task(
    as_caller: dict[str, str], world: Sequence[ObjectRef], what: str, shard: Shard
) -> Transitions | Pairs:
    """One shard of a collection."""
    same_versions(as_caller)
    return _made(_world(world[0]), what, shard)


@functools.lru_cache(1)
def _world(source: ObjectRef) -> World:
    import ray

    world: World = ray.get(source)
    return world
