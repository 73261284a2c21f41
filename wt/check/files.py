"""``wt check`` on files: what it found in each, and the corrected ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from wt.check.finding import AuditFinding, amendments
from wt.check.reading import read
from wt.check.run import check
from wt.data import recording as recordings
from wt.errors import RecordingError, UserError
from wt.mjcf.edit import patched_xml
from wt.mjcf.text import comment
from wt.physics.scene import Scene
from wt.show.files import kept, write_whole
from wt.types import Recording

MARK = "written by wt check"
"""Stands in everything that is written, so that nothing else is ever replaced."""
PAGE = "check.html"


@dataclass(frozen=True, eq=False)
class Audited:
    """One recording's audit, or the model's alone.

    Attributes:
        path: of the recording; None for the model alone.
        given: as it was read.
        corrected: with everything mended that can be.
        findings: of it.
    """

    path: Path | None
    given: Recording | None
    corrected: Recording | None
    findings: tuple[AuditFinding, ...]


def _silent(what: str, share: float) -> None:
    """Say nothing."""


def audit(
    model: Path | None,
    sources: Sequence[Path],
    say: Callable[[str, float], None] = _silent,
) -> list[Audited]:
    """Audit recordings, with their model if there is one; without any, the model alone.

    Args:
        model: the model; None without.
        sources: the recordings.
        say: called with the present step and the share that is done.

    Raises:
        ModelError: the model cannot be read.
        RecordingError: a recording cannot be read, or names what the model does not have.
    """
    scene = Scene(model) if model else None
    if not sources:
        return [Audited(None, None, None, check(scene, None).findings)]
    audited = []
    for i, path in enumerate(sources):
        say(f"checking {path.name}", i / len(sources))
        recording, doubts = read(path)
        if scene is not None:
            try:
                recordings.check_names(recording, scene.given)
            except RecordingError as error:
                raise RecordingError(f"'{path}': {error}") from error
        checked = check(scene, recording)
        audited.append(Audited(path, recording, checked.recording, (*doubts, *checked.findings)))
    return audited


def merged(audited: Sequence[Audited]) -> list[AuditFinding]:
    """The findings of all recordings; what several share stands once, and says so."""
    order: dict[tuple[object, ...], list[AuditFinding]] = {}
    for each in audited:
        for f in each.findings:
            order.setdefault((f.kind, f.columns, f.elements), []).append(f)
    united = []
    for same in order.values():
        first, of_model = same[0], not same[0].columns
        many = len(audited) > 1 and not of_model
        where = f" (in {len(same)} of {len(audited)} recordings)" if many else ""
        united.append(replace(first, evidence=first.evidence + where))
    return sorted(united, key=lambda f: not f.sure)


def refuse(out: Path) -> None:
    """Refuse a folder that no page can be written into, before anything is audited.

    Raises:
        UserError: something else is there, or the folder cannot be written into.
        WorkError: another process writes into it.
    """
    with kept(out):
        _refuse_foreign(out / PAGE)


def write_page(page: str, out: Path) -> Path:
    """Write ``check.html`` into a folder; an earlier one of ours is replaced.

    Raises:
        UserError: something else is there, or the folder cannot be written into.
        WorkError: another process writes into it.
    """
    path = out / PAGE
    with kept(out):
        _refuse_foreign(path)
        write_whole(path, f"{page}\n<!-- {MARK} -->\n")
    return path


def write_fixed(model: Path | None, audited: Sequence[Audited], out: Path) -> list[Path]:
    """Write corrected recordings, and the model if it is to blame, into a folder.

    Recordings of one name are numbered, in the order in which they were given.

    Raises:
        UserError: something else is there under such a name, one of them is an input, or the
            folder cannot be written into.
        WorkError: another process writes into it.
    """
    inputs = [p for p in (model, *(each.path for each in audited)) if p is not None]
    recorded: dict[Path, Audited] = {}
    for each in audited:
        if each.path is not None and each.corrected is not None and _changed(each):
            stem = each.path.stem
            same = sum(
                other.path is not None and other.path.stem == stem for other in recorded.values()
            )
            number = f"-{same + 1}" if same else ""
            recorded[out / f"{stem}{number}.fixed.parquet"] = each
    changes = [f for f in merged(audited) if f.sure and f.model_change]
    amended = {out / f"{model.stem}.fixed.xml": model} if model is not None and changes else {}
    with kept(out):
        for path in (*recorded, *amended):
            _refuse_input(path, inputs)
            _refuse_foreign(path)
        for path, each in recorded.items():
            _write_recording(each, path)
        for path, source in amended.items():
            _write_model(source, changes, path)
    return [*recorded, *amended]


def _changed(each: Audited) -> list[str]:
    """Kinds of what was corrected in a recording."""
    return [f.kind for f in each.findings if f.sure and (f.change or _dropped(f))]


def _write_recording(each: Audited, path: Path) -> None:
    assert each.corrected is not None
    meta = {**each.corrected.meta, "audited": _changed(each), "notes_of_audit": MARK}
    recordings.write(replace(each.corrected, meta=meta), path)


def _write_model(model: Path, changes: Sequence[AuditFinding], path: Path) -> None:
    amended = Scene(model, amendments(changes))
    said = "; ".join(f"{f.kind}: {f.evidence}" for f in changes)
    write_whole(path, f"{patched_xml(amended, (), ())}\n{comment(f'{MARK}: {said}')}\n")


def _dropped(finding: AuditFinding) -> bool:
    """Tell whether rows were left out while reading."""
    return finding.kind in ("stamps_repeated", "clock_backwards")


def _refuse_input(path: Path, inputs: Sequence[Path]) -> None:
    if path.resolve() in [source.resolve() for source in inputs]:
        raise UserError(f"'{path}' is an input; give another folder with --out")


def _refuse_foreign(path: Path) -> None:
    if path.is_symlink() or (path.exists() and MARK.encode() not in path.read_bytes()):
        raise UserError(
            f"'{path}' is there and was not written by wt check; nothing of yours is replaced: "
            "move it, or give another folder with --out"
        )
