"""``wt passport add``: the work in order."""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from wt.data import recording as recordings
from wt.data.labels import Labels, labels_of
from wt.diagnose import again
from wt.diagnose.again import Recorded
from wt.errors import UserError
from wt.passport import folder as folders
from wt.passport.card import card
from wt.passport.estimates import GroupEstimate, common, rows
from wt.passport.folder import Addition, Passport, Source
from wt.passport.parts import Part, parts_of
from wt.passport.support import borne_out
from wt.physics.planted import Hypothesis

Say = Callable[[str, float], None]
_SEARCH = 0.7  # share of the time, roughly


@dataclass(frozen=True, eq=False)
class Added:
    """What was added.

    Attributes:
        passport: with it.
        groups: that are new, or have new recordings.
        known: recordings that were in the passport already.
        files: that were written; none if nothing was new.
    """

    passport: Passport
    groups: tuple[Labels, ...]
    known: tuple[Path, ...]
    files: tuple[Path, ...]


def add(
    model: Path,
    given: Sequence[Path],
    out: Path,
    *,
    seed: int = 0,
    every_group: bool = True,
    each_session: bool = False,
    progress: Say | None = None,
) -> Added:
    """Estimate the same effects in every group of recordings, and append them to a passport.

    Effects are looked for in the new groups; with those that the passport has they are one
    hypothesis, which every group gets estimates of. Earlier groups that lack some are estimated
    again where their recordings are still there.

    Args:
        model: the MJCF, the same for all units.
        given: recordings with labels.
        out: the passport's folder.
        seed: of everything random.
        every_group: whether effects are looked for in each new group, and not in the first of each
            unit only.
        each_session: whether sessions are appended one after the other, as they would have been on
            their days: what changed is then told of each, and not of each unit's last one only.
        progress: called as the work goes on.

    Raises:
        UserError: the passport is of another model, or ``out`` cannot be written into.
        RecordingError: a recording cannot be used, or has no labels.
        WorkError: another process writes into the folder.
    """
    batches: dict[str, dict[Path, Source]] = {}
    for path in dict.fromkeys(given):
        source = _source(path)
        batch = source.labels.session if each_session else ""
        batches.setdefault(batch, {})[path] = source
    say, done = progress or _silent, list[Added]()
    for i, batch in enumerate(sorted(batches)):

        def told(what: str, share: float, i: int = i) -> None:
            say(what, (i + share) / len(batches))

        done.append(_appended(model, batches[batch], out, seed, every_group, told))
    return Added(
        done[-1].passport,
        tuple(labels for added in done for labels in added.groups),
        tuple(path for added in done for path in added.known),
        tuple(path for added in done for path in added.files),
    )


def _appended(
    model: Path, sources: Mapping[Path, Source], out: Path, seed: int, every_group: bool, say: Say
) -> Added:
    """One addition, of recordings that are taken together."""
    with folders.locked(out):
        passport = folders.read(out)
        sha256 = hashlib.sha256(_bytes(model)).hexdigest()
        _refuse_other_model(passport, model, sha256, out)
        there = {s.sha256 for s in passport.sources}
        known = tuple(path for path, s in sources.items() if s.sha256 in there)
        new = {path: s for path, s in sources.items() if s.sha256 not in there}
        if not new:
            return Added(passport, (), known, ())
        found = _estimated(model, passport, new, seed, every_group, say)
        addition = Addition(
            model=str(model),
            model_sha256=sha256,
            made=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            sources=tuple(new.values()),
            hypothesis=found.hypothesis,
            rows=found.rows,
            notes=found.notes,
            parts=found.parts,
        )
        whole = Passport((*passport.additions, addition))
        addition = replace(addition, decided=card(whole.rows, groups=whole.groups).to_json())
        files = folders.append(out, addition)
        groups = tuple(sorted({s.labels for s in new.values()}))
        return Added(Passport((*passport.additions, addition)), groups, known, files)


@dataclass(frozen=True, eq=False)
class _Found:
    hypothesis: Hypothesis
    rows: tuple[GroupEstimate, ...]
    notes: tuple[str, ...]
    parts: tuple[Part, ...]


def _estimated(
    model: Path,
    passport: Passport,
    new: Mapping[Path, Source],
    seed: int,
    every_group: bool,
    say: Say,
) -> _Found:
    """Name effects in new groups, and estimate them wherever they are not yet."""
    earlier, gone = still_there(passport.sources)
    grouped = _grouped({**earlier, **new})
    fresh = sorted({s.labels for s in new.values()})
    read: dict[Labels, Recorded] = {k: again.recorded(model, grouped[k]) for k in fresh}
    asked = fresh if every_group else _first_of_each_unit(fresh, passport.units)
    # what is estimated already speaks for all groups that it is estimated in
    found = [passport.hypothesis] * len(passport.groups)
    for i, labels in enumerate(asked):

        def told(what: str, share: float, i: int = i, labels: Labels = labels) -> None:
            say(f"{labels}: {what}", _SEARCH * (i + share) / len(asked))

        found.append(again.named(read[labels], seed, told))
    hypothesis, notes = common([h for h in found if h])
    searched = [read[labels] for labels in asked]
    hypothesis, unneeded = borne_out(hypothesis, found, searched, passport.hypothesis)
    notes += unneeded
    old = {p.key for p in passport.hypothesis}
    grown = any(p.key not in old for p in hypothesis)
    stale = [k for k in passport.groups if k not in fresh] * grown
    estimates: list[GroupEstimate] = []
    every = [*fresh, *(k for k in stale if k in grouped)]
    for i, labels in enumerate(every):
        say(f"{labels}: estimating", _SEARCH + (1.0 - _SEARCH) * i / len(every))
        if labels not in read:
            read[labels] = again.recorded(model, grouped[labels])
        fitted = again.estimated(read[labels], hypothesis) if hypothesis else ()
        estimates += rows(labels, fitted)
        fits = {p.key for p, _ in fitted}
        notes += tuple(
            f"The recordings of {labels} contradict {p}, which is not estimated there."
            for p in hypothesis
            if p.key not in fits
        )
    lost = [k for k in stale if k not in grouped]
    notes += tuple(
        f"{k} has no estimates of what was found since: its recordings are not where they were."
        for k in lost
    )
    if gone and any(k in fresh for k in gone):
        notes += ("Earlier recordings of these groups are not where they were, and do not count.",)
    return _Found(hypothesis, tuple(estimates), notes, parts_of(read[fresh[0]].scene))


def _silent(what: str, share: float) -> None:
    """Say nothing."""


def _source(path: Path) -> Source:
    _, meta = recordings.table(path)
    return Source(str(path.resolve()), hashlib.sha256(_bytes(path)).hexdigest(),
                  labels_of(meta, str(path)))  # fmt: skip


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise UserError(f"'{path}' cannot be read ({error.strerror}); name another file") from error


def _refuse_other_model(passport: Passport, model: Path, sha256: str, out: Path) -> None:
    for addition in passport.additions[:1]:
        if addition.model_sha256 != sha256:
            raise UserError(
                f"--out {out} is the passport of '{addition.model}' (SHA-256 "
                f"{addition.model_sha256[:12]}…), and {model} is another model: give that one, or "
                "name another folder"
            )


def still_there(sources: Iterable[Source]) -> tuple[dict[Path, Source], set[Labels]]:
    """Recordings that are where they were, unchanged; and the groups of which some are not."""
    there, gone = {}, set()
    for source in sources:
        path = Path(source.path)
        same = path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == source.sha256
        if same:
            there[path] = source
        else:
            gone.add(source.labels)
    return there, gone


def _grouped(sources: Mapping[Path, Source]) -> dict[Labels, list[Path]]:
    groups: dict[Labels, list[Path]] = {}
    for path, source in sources.items():
        groups.setdefault(source.labels, []).append(path)
    return groups


def _first_of_each_unit(groups: Sequence[Labels], known: Sequence[str]) -> list[Labels]:
    first: dict[str, Labels] = {}
    for labels in groups:
        if labels.unit not in known:
            first.setdefault(labels.unit, labels)
    return list(first.values())
