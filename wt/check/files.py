"""``wt check`` on files: what it found in each, and the corrected ones."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
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


class Outputs:
    """A folder that is kept for what an audit writes into it.

    Attributes:
        folder: where it is.
    """

    def __init__(self, folder: Path) -> None:
        """Take a folder that is kept already; see :func:`outputs`."""
        self.folder = folder

    def page(self, page: str) -> Path:
        """Write ``check.html``; an earlier one of ours is replaced.

        Raises:
            UserError: something else is there.
        """
        path = self.folder / PAGE
        _refuse_foreign(path)
        write_whole(path, f"{page}\n<!-- {MARK} -->\n")
        return path

    def fixed(self, model: Path | None, audited: Sequence[Audited]) -> list[Path]:
        """Write corrected recordings, and the model if it is to blame.

        Recordings of one name are numbered, in the order in which they were given.

        Raises:
            UserError: something else is there under such a name, or one of them is an input.
        """
        inputs = [p for p in (model, *(each.path for each in audited)) if p is not None]
        recorded = _named(self.folder, audited)
        changes = [f for f in merged(audited) if f.sure and f.model_change]
        amended = dict[Path, Path]()
        if model is not None and changes:
            amended = {self.folder / f"{model.stem}.fixed.xml": model}
        for path in (*recorded, *amended):
            _refuse_input(path, inputs)
            _refuse_foreign(path)
        for path, each in recorded.items():
            _write_recording(each, path)
        for path, source in amended.items():
            _write_model(source, changes, path)
        return [*recorded, *amended]


@contextlib.contextmanager
def outputs(out: Path) -> Iterator[Outputs]:
    """Keep a folder for what is to be written, and other processes out of it.

    Whatever can be wrong with the folder is said here, before anything is audited.

    Raises:
        UserError: something else is there, or the folder cannot be written into.
        WorkError: another process writes into it.
    """
    with kept(out):
        _refuse_foreign(out / PAGE)
        yield Outputs(out)


def _named(folder: Path, audited: Sequence[Audited]) -> dict[Path, Audited]:
    """Where corrected recordings go."""
    recorded: dict[Path, Audited] = {}
    for each in audited:
        if each.path is not None and each.corrected is not None and _changed(each):
            stem = each.path.stem
            same = sum(
                other.path is not None and other.path.stem == stem for other in recorded.values()
            )
            number = f"-{same + 1}" if same else ""
            recorded[folder / f"{stem}{number}.fixed.parquet"] = each
    return recorded


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
