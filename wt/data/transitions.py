"""Collected transitions on disk: Parquet shards and a manifest, reused and resumed.

A collection's folder is named after the hash of everything that decides its content (world
options, compiled models, seed, count, format). Shards are written to a temporary name and renamed
when whole; an interrupted collection continues after its last whole shard, and one that is
complete is read instead of made again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Shaped

from wt.errors import DataError
from wt.types import Channel, Pairs, Transitions, TransitionSpec

FORMAT = 1
MANIFEST = "manifest.json"

Made = tuple["Shard", Transitions | Pairs]
"""A shard and its content."""
Make = Callable[[Sequence["Shard"]], Iterable[Made]]
"""Makes the shards that it is given, in any order."""
ROW_GROUP = 32_768
"""Most transitions that are read at once of a collection that memory does not hold."""


@dataclass(frozen=True)
class Shard:
    """One piece of a collection: a file, its seed and how many transitions it holds."""

    file: str
    seed: int
    count: int


def digest(content: object) -> str:
    """SHA-256 of plain content (numbers, strings, lists, dictionaries), as 16 hex digits."""
    text = json.dumps(content, sort_keys=True, default=list)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def plan(count: int, seed: int, shard: int) -> list[Shard]:
    """Split a collection into shards with seeds of their own.

    Args:
        count: transitions in all.
        seed: of the collection.
        shard: most transitions per shard.
    """
    sizes = [min(shard, count - start) for start in range(0, count, shard)]
    seeds = np.random.SeedSequence(seed).generate_state(len(sizes))
    return [
        Shard(f"part-{i:03d}.parquet", int(s), n)
        for i, (n, s) in enumerate(zip(sizes, seeds, strict=True))
    ]


def obtain(
    folder: Path,
    identity: dict[str, Any],
    spec: TransitionSpec,
    shards: Sequence[Shard],
    make: Make,
) -> Transitions | Pairs:
    """Read a collection, first making whatever shards are missing; arguments as of :func:`ensure`.

    Returns:
        All shards joined, in order; episodes are numbered on.

    Raises:
        DataError: a shard is truncated or of another layout.
    """
    home = ensure(folder, identity, spec, shards, make)
    return join([read(home / shard.file, spec) for shard in shards])


def ensure(
    folder: Path,
    identity: dict[str, Any],
    spec: TransitionSpec,
    shards: Sequence[Shard],
    make: Make,
) -> Path:
    """Make whatever shards of a collection are missing, and read none.

    Args:
        folder: parent folder; the collection gets its own folder below, named by its hash.
        identity: plain content that decides what is collected; its hash decides about reuse.
        spec: layout of the transitions.
        shards: as from :func:`plan`.
        make: collects those that are missing; each is written when it comes.

    Returns:
        The collection's own folder.
    """
    home = home_of(folder, identity, spec, shards)
    identity = _in_full(identity, shards)
    home.mkdir(parents=True, exist_ok=True)
    for shard, content in make([s for s in shards if not (home / s.file).exists()]):
        _write(home / shard.file, content, spec)
    manifest = json.dumps(_manifest(identity, spec), indent=1).encode()
    kept = home / MANIFEST
    # the workers of a run all read the collection at once: one that is whole is only read
    if not kept.exists() or kept.read_bytes() != manifest:
        _write_whole(kept, manifest)
    return home


def home_of(
    folder: Path, identity: dict[str, Any], spec: TransitionSpec, shards: Sequence[Shard]
) -> Path:
    """Folder of a collection; arguments as of :func:`ensure`."""
    name = f"{spec.task}-{identity['what']}-{digest(_in_full(identity, shards))}"
    return folder / name


def _in_full(identity: dict[str, Any], shards: Sequence[Shard]) -> dict[str, Any]:
    parts = [[s.file, s.seed, s.count] for s in shards]
    return {"format": FORMAT, **identity, "shards": parts}


def content_hash(data: Transitions | Pairs | Iterable[Transitions]) -> str:
    """SHA-256 of transitions themselves, row by row, as 16 hex digits.

    It names data in MLflow and in model cards, and is the same however they are divided: into the
    parts of a collection that memory does not hold, or not at all.
    """
    sha = hashlib.sha256()
    for part in [data] if isinstance(data, Transitions | Pairs) else data:
        real = part.real if isinstance(part, Pairs) else part
        for first in range(0, len(real), ROW_GROUP):
            rows = slice(first, first + ROW_GROUP)
            together = np.hstack([real.o[rows], real.a[rows], real.s_next[rows]])
            sha.update(np.ascontiguousarray(together).tobytes())
    return sha.hexdigest()[:16]


def _manifest(identity: dict[str, Any], spec: TransitionSpec) -> dict[str, Any]:
    groups = {"o": spec.observation, "a": spec.action, "s_next": spec.state, "h": spec.hidden}
    return {
        **identity,
        "hash": digest(identity),
        "rate_hz": spec.rate_hz,
        "units": {f"{g}/{c.name}": c.unit for g, channels in groups.items() for c in channels},
    }


def _columns(spec: TransitionSpec) -> dict[str, tuple[str, tuple[Channel, ...]]]:
    """Field of Transitions → (column prefix, channels)."""
    return {
        "o": ("o", spec.observation),
        "a": ("a", spec.action),
        "s_next": ("s_next", spec.state),
        "nominal": ("nominal", spec.state),
        "hidden": ("h", spec.hidden),
    }


def _write(path: Path, data: Transitions | Pairs, spec: TransitionSpec) -> None:
    real = data.real if isinstance(data, Pairs) else data
    table = {
        f"{prefix}/{channel.name}": getattr(real, field)[:, i]
        for field, (prefix, channels) in _columns(spec).items()
        for i, channel in enumerate(channels)
    }
    if isinstance(data, Pairs):
        table |= {f"sim_next/{c.name}": data.sim_next[:, i] for i, c in enumerate(spec.state)}
    table |= {"episode": real.episode, "step": real.step}
    temporary = _temporary(path)
    try:
        pq.write_table(
            pa.table(table),
            temporary,
            row_group_size=ROW_GROUP,
            use_dictionary=False,  # measured numbers hardly repeat
            compression="zstd",
            write_page_checksum=True,
        )
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def groups_of(path: Path) -> list[int]:
    """Transitions in each row group of a shard, from its footer.

    Raises:
        DataError: it is truncated.
    """
    with _readable(path):
        footer = pq.read_metadata(path)
    return [footer.row_group(i).num_rows for i in range(footer.num_row_groups)]


def read(path: Path, spec: TransitionSpec, group: int | None = None) -> Transitions | Pairs:
    """A shard, or one of its row groups.

    Raises:
        DataError: it is damaged, or of another layout.
    """
    with _readable(path):
        if group is None:
            table = pq.read_table(path, page_checksum_verification=True)
        else:
            with pq.ParquetFile(path, page_checksum_verification=True) as file:
                # the cores are for other workers
                table = file.read_row_group(group, use_threads=False)

    def column(name: str) -> Shaped[np.ndarray, " row"]:
        if name not in table.column_names:
            raise DataError(f"it has no column {name!r} and belongs to another task")
        return table[name].to_numpy()

    def matrix(prefix: str, channels: tuple[Channel, ...]) -> Shaped[np.ndarray, "row channel"]:
        columns = [column(f"{prefix}/{c.name}") for c in channels]
        return np.stack(columns, axis=1) if columns else np.empty((len(table), 0), np.float32)

    try:
        fields = {field: matrix(*where) for field, where in _columns(spec).items()}
        transitions = Transitions(**fields, episode=column("episode"), step=column("step"))
        if not any(n.startswith("sim_next/") for n in table.column_names):
            return transitions
        return Pairs(transitions, matrix("sim_next", spec.state))
    except (DataError, ValueError) as error:  # numpy's, where numbers should be and are not
        raise DataError(f"{path} is not a part of this collection: {error}; delete it") from error


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowInvalid, OSError) as error:
        raise DataError(
            f"{path} cannot be read ({str(error).splitlines()[0]}); delete it and run again, "
            "only this part is collected anew"
        ) from error


def join(parts: Sequence[Transitions | Pairs]) -> Transitions | Pairs:
    """Parts as one, in order; episodes are numbered on."""
    reals = [p.real if isinstance(p, Pairs) else p for p in parts]
    firsts = np.cumsum([0] + [int(r.episode.max()) + 1 for r in reals[:-1]])
    joined = Transitions(
        **{
            name: np.concatenate([getattr(r, name) for r in reals])
            for name in ("o", "a", "s_next", "nominal", "hidden", "step")
        },
        episode=np.concatenate([r.episode + first for r, first in zip(reals, firsts, strict=True)]),
    )
    if isinstance(parts[0], Pairs):
        answers = [p.sim_next for p in parts if isinstance(p, Pairs)]
        return Pairs(joined, np.concatenate(answers))
    return joined


def _write_whole(path: Path, content: bytes) -> None:
    temporary = _temporary(path)
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    """A name of this process's own: two runs may collect the same at the same time."""
    return path.with_suffix(f".{os.getpid()}.tmp")
