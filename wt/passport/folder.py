"""A passport on disk: a folder that only ever grows.

Each addition is two files, ``0001-<hash>.parquet``, one row a group and parameter, and
``0001-<hash>.json``: what was given, which effects were estimated, and what was decided. The hash
is that of the JSON file's content, which holds the Parquet file's hash and that of the addition
before, so that a file that was changed, or is missing, is noticed. Where a group was estimated
again, its latest rows count.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wt.data.labels import Labels
from wt.errors import DataError
from wt.passport.estimates import GroupEstimate, Quantity
from wt.passport.parts import Part
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.show.files import kept, write_together
from wt.types import Location

SCHEMA = 1
_NAME = re.compile(r"(\d{4,})-([0-9a-f]{16})\.(parquet|json)")
_DIGITS = 16  # of a hash, in a name


@dataclass(frozen=True)
class Source:
    """A recording that estimates are of.

    Attributes:
        path: where it was.
        sha256: hash of its bytes.
        labels: its group.
    """

    path: str
    sha256: str
    labels: Labels


@dataclass(frozen=True, eq=False)
class Addition:
    """What one call adds.

    Attributes:
        model: path of the MJCF.
        model_sha256: hash of its bytes.
        made: time in UTC, ISO 8601.
        sources: recordings that its rows are of.
        hypothesis: effects that were estimated.
        rows: estimates.
        decided: what was decided with all rows so far, as JSON.
        notes: what was left out, and why.
        parts: of the machine; none in what older versions wrote.
    """

    model: str
    model_sha256: str
    made: str
    sources: tuple[Source, ...]
    hypothesis: Hypothesis
    rows: tuple[GroupEstimate, ...]
    decided: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()


@dataclass(frozen=True, eq=False)
class Passport:
    """All additions of a folder, in order."""

    additions: tuple[Addition, ...] = ()

    @property
    def rows(self) -> tuple[GroupEstimate, ...]:
        """The latest estimate of each quantity in each group."""
        latest = {(r.labels, r.quantity): r for a in self.additions for r in a.rows}
        return tuple(latest[key] for key in sorted(latest))

    @property
    def sources(self) -> tuple[Source, ...]:
        """Every recording, once."""
        return tuple({s.sha256: s for a in self.additions for s in a.sources}.values())

    @property
    def hypothesis(self) -> Hypothesis:
        """Effects that are estimated, as of the latest addition."""
        return self.additions[-1].hypothesis if self.additions else ()

    @property
    def parts(self) -> tuple[Part, ...]:
        """Every joint, drive and sensor, as of the latest addition."""
        return self.additions[-1].parts if self.additions else ()

    @property
    def groups(self) -> tuple[Labels, ...]:
        """Labels of all groups."""
        return tuple(sorted({s.labels for s in self.sources}))

    @property
    def units(self) -> tuple[str, ...]:
        """Names of all units."""
        return tuple(dict.fromkeys(labels.unit for labels in self.groups))


def read(folder: Path) -> Passport:
    """Read a passport; an empty one if the folder holds none, or is not there.

    Raises:
        DataError: a file is missing, broken, or was changed.
    """
    additions: list[Addition] = []
    before: str | None = None
    for path in _entries(folder):
        content = path.read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        match = _NAME.fullmatch(path.name)
        if match is None or match[2] != digest[:_DIGITS]:
            raise DataError(f"{path} was changed since it was written; restore it from a copy")
        try:
            said = json.loads(content)
            previous, addition = said["before"], _addition(folder, said)
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(
                f"{path} is no addition to a passport of schema {SCHEMA} ({error!r}); use the "
                "version of wt that wrote it"
            ) from error
        if previous != before:
            raise DataError(f"{path} follows an addition that is not there; restore it from a copy")
        additions.append(addition)
        before = digest
    return Passport(tuple(additions))


@contextlib.contextmanager
def locked(folder: Path, option: str = "--out") -> Iterator[None]:
    """Keep other processes out of a passport's folder, which is made if it is not there.

    Raises:
        UserError: it is a file, or cannot be written into.
        WorkError: another process writes into it.
    """
    with kept(folder, option):
        yield


def append(folder: Path, addition: Addition) -> tuple[Path, Path]:
    """Add files to a folder that is :func:`locked`; none that is there is touched.

    Returns:
        The Parquet file and the JSON file.
    """
    entries = _entries(folder)
    before = hashlib.sha256(entries[-1].read_bytes()).hexdigest() if entries else None
    table = _parquet(addition.rows)
    said = {
        "schema": SCHEMA,
        "made": addition.made,
        "before": before,
        "model": {"path": addition.model, "sha256": addition.model_sha256,
                  "parts": [asdict(p) for p in addition.parts]},
        "estimates_sha256": hashlib.sha256(table).hexdigest(),
        "recordings": [{"path": s.path, "sha256": s.sha256, **asdict(s.labels)}
                       for s in addition.sources],
        "effects": [{"effect": p.effect.id, "at": asdict(p.at), "theta": p.theta.tolist()}
                    for p in addition.hypothesis],
        "decided": addition.decided,
        "notes": list(addition.notes),
    }  # fmt: skip
    text = json.dumps(said, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    stem = f"{_next(folder):04d}-{hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]}"
    names = f"{stem}.parquet", f"{stem}.json"
    # an addition is there once its JSON file is: that is renamed last
    write_together(folder, {names[0]: table, names[1]: text})
    return folder / names[0], folder / names[1]


def _entries(folder: Path) -> list[Path]:
    """JSON files of additions, in order."""
    if not folder.is_dir():
        return []
    found = [p for p in folder.glob("*.json") if _NAME.fullmatch(p.name)]
    return sorted(found, key=lambda p: (int(p.name.partition("-")[0]), p.name))


def _next(folder: Path) -> int:
    """A number that no file has, an interrupted addition's among them."""
    taken = [int(m[1]) for p in folder.iterdir() if (m := _NAME.fullmatch(p.name))]
    return max(taken, default=0) + 1


def _addition(folder: Path, said: Mapping[str, Any]) -> Addition:
    if said["schema"] != SCHEMA:
        raise ValueError(f"schema {said['schema']}")
    known = effects()
    hypothesis = tuple(
        Planted(known[e["effect"]], Location(**e["at"]), np.array(e["theta"], float))
        for e in said["effects"]
    )
    sources = tuple(
        Source(r["path"], r["sha256"], Labels(r["unit"], r["session"], r["load"]))
        for r in said["recordings"]
    )
    return Addition(
        said["model"]["path"], said["model"]["sha256"], said["made"], sources, hypothesis,
        _rows(folder, said["estimates_sha256"]), said["decided"], tuple(said["notes"]),
        tuple(Part(p["sort"], p["name"]) for p in said["model"].get("parts", [])),
    )  # fmt: skip


def _parquet(rows: Sequence[GroupEstimate]) -> bytes:
    flat = [
        {**asdict(r.labels), **asdict(r.quantity), "value": r.value, "error": r.error,
         "neutral": r.neutral, "warning": r.warning}
        for r in rows
    ]  # fmt: skip
    content = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(flat, _COLUMNS), content)
    return content.getvalue()


_COLUMNS = pa.schema(
    [
        *((name, pa.string()) for name in ("unit", "session", "load", "effect", "kind", "place")),
        *((name, pa.string()) for name in ("parameter", "measured_in")),
        *((name, pa.float64()) for name in ("value", "error", "neutral")),
        ("warning", pa.string()),
    ]
)


def _rows(folder: Path, sha256: str) -> tuple[GroupEstimate, ...]:
    """Rows of the Parquet file that has this hash."""
    for path in sorted(folder.glob("*.parquet")):
        content = path.read_bytes() if _NAME.fullmatch(path.name) else b""
        if hashlib.sha256(content).hexdigest() == sha256:
            return tuple(_row(r) for r in pq.read_table(io.BytesIO(content)).to_pylist())
    raise DataError(
        f"{folder} holds no Parquet file with the hash {sha256[:_DIGITS]}…, or it was changed; "
        "restore it from a copy"
    )


def _row(r: Mapping[str, Any]) -> GroupEstimate:
    return GroupEstimate(
        Labels(r["unit"], r["session"], r["load"]),
        Quantity(r["effect"], r["kind"], r["place"], r["parameter"], r["measured_in"]),
        r["value"], r["error"], r["neutral"], r["warning"],
    )  # fmt: skip
