"""``wt check`` on files: what it found in each, and the corrected ones."""

from __future__ import annotations

from collections.abc import Sequence
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


def audit(model: Path | None, sources: Sequence[Path]) -> list[Audited]:
    """Audit recordings, with their model if there is one; without any, the model alone.

    Raises:
        ModelError: the model cannot be read.
        RecordingError: a recording cannot be read, or names what the model does not have.
    """
    scene = Scene(model) if model else None
    if not sources:
        return [Audited(None, None, None, check(scene, None).findings)]
    audited = []
    for path in sources:
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


def write_page(page: str, out: Path) -> Path:
    """Write ``check.html`` into a folder; an earlier one of ours is replaced.

    Raises:
        UserError: something else is there, or the folder cannot be written into.
        WorkError: another process writes into it.
    """
    path = out / "check.html"
    with kept(out):
        _refuse_foreign(path)
        write_whole(path, f"{page}\n<!-- {MARK} -->\n")
    return path


def write_fixed(model: Path | None, audited: Sequence[Audited], out: Path) -> list[Path]:
    """Write corrected recordings, and the model if it is to blame, into a folder.

    Raises:
        UserError: something else is there under such a name, or the folder cannot be written into.
        WorkError: another process writes into it.
    """
    with kept(out):
        written = [_write_recording(each, out) for each in audited]
        if model is not None:
            written.append(_write_model(model, merged(audited), out))
    return [path for path in written if path is not None]


def _write_recording(each: Audited, out: Path) -> Path | None:
    """Write a corrected recording; None if nothing of it was changed."""
    changed = [f.kind for f in each.findings if f.sure and (f.change or _dropped(f))]
    if each.path is None or each.corrected is None or not changed:
        return None
    path = out / f"{each.path.stem}.fixed.parquet"
    _refuse_input(path, each.path)
    _refuse_foreign(path)
    meta = {**each.corrected.meta, "audited": changed, "notes_of_audit": MARK}
    recordings.write(replace(each.corrected, meta=meta), path)
    return path


def _write_model(model: Path, findings: Sequence[AuditFinding], out: Path) -> Path | None:
    """Write a corrected model; None if it is not to blame."""
    changes = [f for f in findings if f.sure and f.model_change]
    if not changes:
        return None
    path = out / f"{model.stem}.fixed.xml"
    _refuse_input(path, model)
    _refuse_foreign(path)
    amended = Scene(model, amendments(changes))
    said = "; ".join(f"{f.kind}: {f.evidence}" for f in changes)
    write_whole(path, f"{patched_xml(amended, (), ())}\n{comment(f'{MARK}: {said}')}\n")
    return path


def _dropped(finding: AuditFinding) -> bool:
    """Tell whether rows were left out while reading."""
    return finding.kind in ("stamps_repeated", "clock_backwards")


def _refuse_input(path: Path, source: Path) -> None:
    if path.resolve() == source.resolve():
        raise UserError(f"'{path}' is an input; give another folder with --out")


def _refuse_foreign(path: Path) -> None:
    if path.exists() and MARK.encode() not in path.read_bytes():
        raise UserError(
            f"'{path}' is there and was not written by wt check; nothing of yours is replaced: "
            "move it, or give another folder with --out"
        )
