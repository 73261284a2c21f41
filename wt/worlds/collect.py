"""The collections of a task: both domains unpaired, and pairs for tests, or also to select by."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from wt.config import DataConfig
from wt.data.stored import Stored, Streams, held_out, transitions
from wt.data.transitions import content_hash, digest, ensure, obtain, plan
from wt.errors import DataError
from wt.types import Pairs, Recording, Transitions
from wt.worlds import varied
from wt.worlds.base import World
from wt.worlds.recorded import Recorded
from wt.worlds.spread import LESSONS, Here, Maker, Report
from wt.worlds.varied import Varied


@dataclass(frozen=True)
class Collected:
    """Everything that is collected for a task.

    Attributes:
        sim: unpaired transitions of S, for training; where there are more than memory is to hold, a
            sample of those that are not held out.
        real: unpaired transitions of R, likewise.
        validation: pairs to select models by; None where they are selected without.
        test: pairs that are evaluated once, at the end.
        lessons: transitions of simulators around S, in the layout of
            :func:`wt.worlds.varied.lessons_spec`; None where the world cannot vary S, or nobody
            asks for them.
        folders: of each on disk, by its name here.
        streams: whole collections of which ``sim`` or ``real`` is a sample.
    """

    sim: Transitions
    real: Transitions
    validation: Pairs | None
    test: Pairs
    lessons: Transitions | None = None
    folders: Mapping[str, Path] = field(default_factory=dict)
    streams: Streams = field(default_factory=Streams)
    _digests: dict[str, str] = field(default_factory=dict, init=False, repr=False)

    def whole(self, what: str) -> Transitions | Pairs | Stored:
        """A collection by its name here, where it is streamed not the sample but all of it."""
        stored = getattr(self.streams, what, None)
        data: Transitions | Pairs | Stored = getattr(self, what) if stored is None else stored
        return data

    def digest(self, what: str) -> str:
        """Hash of a whole collection's content, by its name here, however much memory holds."""
        if what not in self._digests:
            data = self.whole(what)
            parts = data.parts() if isinstance(data, Stored) else data
            self._digests[what] = content_hash(parts)
        return self._digests[what]


def collect(
    world: World,
    settings: DataConfig,
    report: Report | None = None,
    *,
    validation: bool = True,
    lessons: bool = False,
    maker: Maker | None = None,
) -> Collected:
    """Collect or reuse the collections of a task.

    Args:
        world: the task.
        settings: folder, sizes and seed.
        report: for a progress bar.
        validation: whether pairs to select by are needed.
        lessons: whether simulators around S are, where the world can vary it.
        maker: makes shards that are missing, of the same world; None to make them here.

    Raises:
        DataError: a stored part is damaged.
    """
    maker = maker or Here(world)
    models = {domain: model_hash(world.model(domain)) for domain in ("sim", "real")}
    collections: dict[str, Transitions | Pairs] = {}
    streamed: dict[str, Stored] = {}
    folders = {}
    asked = {"validation": validation, LESSONS: lessons and isinstance(world, Varied)}
    for what, count, seed in _parts(settings):
        if not asked.get(what, True) or not count:
            continue
        shards = plan(count, seed, world.shard)
        identity = {"what": what, **world.identity(), "models": models}
        spec = world.spec
        if what == LESSONS:
            identity["around"], spec = varied.identity(), varied.lessons_spec(spec)
        make = functools.partial(maker.made, what, report=report)
        where = Path(settings.dir), identity, spec, shards, make
        folders[what] = home = ensure(*where)
        stored = Stored.of([home / shard.file for shard in shards], spec)
        if what in ("sim", "real") and len(stored) > settings.in_memory:
            # of what may be held out the sample has nothing, so that it can be trained on
            trained = stored.without_last(held_out(len(stored), settings.held_out))
            streamed[what], collections[what] = stored, trained.sample(settings.in_memory)
        else:
            collections[what] = obtain(*where)
    return Collected(
        transitions(collections["sim"]),
        transitions(collections["real"]),
        _pairs(collections["validation"]) if validation else None,
        _pairs(collections["test"]),
        transitions(collections[LESSONS]) if LESSONS in collections else None,
        folders,
        Streams(streamed.get("sim"), streamed.get("real"), settings.in_memory),
    )


def recorded(world: Recorded, settings: DataConfig, robots: int) -> list[Recording]:
    """Recordings of the very walks that R's unpaired transitions are from, the first of them.

    Args:
        world: one that can be recorded.
        settings: of the collection.
        robots: number of recordings.

    Raises:
        WorkError: too few robots walk through an episode.
    """
    count, seed = next((count, seed) for what, count, seed in _parts(settings) if what == "real")
    first = plan(count, seed, world.shard)[0]
    return world.record(first.count, first.seed, robots)


def _parts(settings: DataConfig) -> Iterator[tuple[str, int, int]]:
    """(name, size, seed) of each collection."""
    counts = {
        "sim": settings.transitions,
        "real": settings.real_transitions or settings.transitions,
        "validation": settings.validation_pairs,
        "test": settings.test_pairs,
        LESSONS: settings.transitions if settings.lessons is None else settings.lessons,
    }
    seeds = np.random.SeedSequence(settings.seed).generate_state(len(counts))
    for (what, count), seed in zip(counts.items(), seeds, strict=True):
        yield what, count, int(seed)


def model_hash(model: mujoco.MjModel) -> str:
    """A hash of a compiled model, so that a changed model is collected anew."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return digest(buffer.tobytes().hex())


def _pairs(collection: Transitions | Pairs) -> Pairs:
    if isinstance(collection, Pairs):
        return collection
    raise DataError("a collection of transitions lies where pairs belong; delete that folder")
