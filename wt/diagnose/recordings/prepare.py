"""Reading of recordings: checked against the model, completed, and split.

Completed: with the pose of a floating base, if only its IMU was recorded. Split: into fitted and
held-out parts.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wt.check.finding import AuditFinding
from wt.check.run import check
from wt.data import recording as recordings
from wt.diagnose.evidence import Role
from wt.diagnose.recordings.odometry import located
from wt.diagnose.recordings.repeated import refuse_repeated
from wt.diagnose.recordings.samples import ESTIMATED, Part, stamps
from wt.diagnose.result import Used
from wt.errors import RecordingError
from wt.physics.scene import Scene
from wt.types import Recording

Source = str | Path | Recording

_HELD_SHARE = 0.25
_STILL = 1e-6
GIVEN = "recordings given with --holdout"
"""How recordings were split where the user said it."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """Checked and completed recordings, split.

    Attributes:
        fit: parts that may be fitted.
        held: parts that only the proof sees.
        used: what the user gave, and for what it is used.
        names: name of each recording, by index.
        split: in words.
        audit: what was wrong with the recordings, or with the model beside them; the recordings
            are as corrected.
    """

    fit: tuple[Part, ...]
    held: tuple[Part, ...]
    used: tuple[Used, ...]
    names: tuple[str, ...]
    split: str
    audit: tuple[AuditFinding, ...] = ()

    @property
    def whole(self) -> tuple[Part, ...]:
        """All recordings, none held out."""
        return tuple(
            {p.index: Part(p.recording, p.index) for p in (*self.fit, *self.held)}.values()
        )


def prepare(
    scene: Scene,
    given: Sequence[Source],
    holdout: Sequence[Source],
    once_read: Callable[[Sequence[Used]], None] | None = None,
) -> Prepared:
    """Read, check, audit, complete and split recordings.

    Args:
        scene: the machine.
        given: recordings to fit; some of them are held out if ``holdout`` is empty.
        holdout: recordings for the proof only.
        once_read: told what was given before it is audited, which takes longer.

    Raises:
        RecordingError: one of them cannot be used, or where its base was cannot be known; the
            message names it.
    """
    if not given:
        raise RecordingError("no recording was given; give at least one .parquet file")
    files = [s for s in (*given, *holdout) if not isinstance(s, Recording)]
    recordings.refuse_more_than_helps(recordings.sizes_of(files))
    _refuse_twice(given, holdout)
    raw = [_read(scene, source, i) for i, source in enumerate([*given, *holdout])]
    if once_read:
        whole = [
            Used(name, "fit" if i < len(given) else "holdout", r.seconds, r.rate_hz)
            for i, (name, r) in enumerate(raw)
        ]
        once_read(whole)
    audit: dict[tuple[object, ...], AuditFinding] = {}
    named = _numbered([(name, _audited(scene, name, r, audit)) for name, r in raw])
    refuse_repeated(named, len(given))
    parts = [Part(r, i) for i, (_, r) in enumerate(named)]
    fit, held_out = parts[: len(given)], parts[len(given) :]
    split = GIVEN
    if not held_out and len(fit) > 1:
        total = sum(p.recording.seconds for p in fit)
        while (
            len(fit) > 1 and sum(p.recording.seconds for p in held_out) < 0.8 * _HELD_SHARE * total
        ):
            held_out.insert(0, fit.pop())
        split = "the last of the recordings"
    elif not held_out:
        (single,) = fit
        fit, held_out = _cut(single)
        split = "the last quarter of the recording"
    return _split(fit, held_out, tuple(name for name, _ in named), split, tuple(audit.values()))


def unsplit(scene: Scene, given: Sequence[Source]) -> tuple[Part, ...]:
    """All of some recordings, read, checked and completed; nothing is held out.

    Raises:
        RecordingError: one of them cannot be used; the message names it.
    """
    audit: dict[tuple[object, ...], AuditFinding] = {}
    raw = [_read(scene, source, i) for i, source in enumerate(given)]
    return tuple(Part(_audited(scene, *named, audit), i) for i, named in enumerate(raw))


def turned(prepared: Prepared) -> Prepared | None:
    """The same recordings with others held out: the first ones, or the first part of the only one.

    None where the user said which are for the proof only.
    """
    if prepared.split == GIVEN:
        return None
    first, *rest = prepared.fit
    names = prepared.names
    if len(names) == 1:
        single = Part(first.recording, first.index)
        cut = _HELD_SHARE * single.seconds
        held_out, fit = replace(single, span=(0.0, cut)), replace(single, span=(cut, np.inf))
        split = "the first quarter of the recording, in its turn"
        return _split([fit], [held_out], names, split, prepared.audit)
    fitted = [*rest, *prepared.held]
    split = "the first of the recordings, in its turn"
    return _split(fitted, [first], names, split, prepared.audit)


def _split(
    fit: list[Part],
    held_out: list[Part],
    names: tuple[str, ...],
    split: str,
    audit: tuple[AuditFinding, ...],
) -> Prepared:
    used = [
        Used(names[p.index], role, p.seconds, p.recording.rate_hz)
        for role, parts in _roles(fit, held_out)
        for p in parts
    ]
    return Prepared(tuple(fit), tuple(held_out), tuple(used), names, split, audit)


def _refuse_twice(given: Sequence[Source], holdout: Sequence[Source]) -> None:
    """Refuse contents that are to be fitted and to prove the fit, or to count twice."""
    seen: dict[str, tuple[Source, bool]] = {}
    named = [(s, False) for s in given] + [(s, True) for s in holdout]
    for source, held in named:
        if isinstance(source, Recording) or not Path(source).is_file():
            continue
        with Path(source).open("rb") as file:
            contents = hashlib.file_digest(file, "sha256").hexdigest()
        if contents not in seen:
            seen[contents] = source, held
            continue
        earlier, held_before = seen[contents]
        same = "" if str(earlier) == str(source) else f", which holds the same as '{earlier}',"
        if held == held_before:
            raise RecordingError(
                f"'{source}'{same} is given twice: what is told twice is no more likely; name it "
                "once"
            )
        raise RecordingError(
            f"'{source}'{same} is to be fitted and held out: what was fitted proves nothing; give "
            "another recording of the same machine, or leave --holdout out"
        )


def _roles(fit: list[Part], held_out: list[Part]) -> tuple[tuple[Role, list[Part]], ...]:
    return ("fit", fit), ("holdout", held_out)


def _read(scene: Scene, source: Source, index: int) -> tuple[str, Recording]:
    """One recording as it was given, of this machine, and its name."""
    if isinstance(source, Recording):
        name = str(source.meta.get("source", f"recording {index + 1}"))
        recording = source
    else:
        name, recording = str(source), recordings.read(source)
    with _naming(name):
        recordings.check_against(recording, scene.given)
        _check_contents(scene, recording)
    return name, recording


def _audited(
    scene: Scene, name: str, recording: Recording, audit: dict[tuple[object, ...], AuditFinding]
) -> Recording:
    """A recording as corrected; what was wrong with it joins the audit."""
    with _naming(name):
        checked = check(scene, recording)
        for f in checked.findings:
            if f.sure:
                audit.setdefault((f.kind, f.columns, f.elements), f)
        assert checked.recording is not None
        return _completed(scene, checked.recording)


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Errors within name the recording."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"'{name}': {error}") from error


def _numbered(named: list[tuple[str, Recording]]) -> list[tuple[str, Recording]]:
    """Recordings of one name with a number behind it."""
    numbered: list[tuple[str, Recording]] = []
    for name, recording in named:
        same = sum(other == name for other, _ in named[: len(numbered)])
        numbered.append((f"{name} ({same + 1})" if same else name, recording))
    return numbered


def _check_contents(scene: Scene, recording: Recording) -> None:
    for name, column in recording.columns.items():
        if not np.isfinite(column).any():
            raise RecordingError(f"column '{name}' has no finite value; leave it out")
    actuators = [scene.model.actuator(i).name for i in range(scene.model.nactuator)]
    missing = [name for name in actuators if f"ctrl/{name}" not in recording.columns]
    if missing:
        raise RecordingError(
            f"column 'ctrl/{missing[0]}' is missing: the command of every actuator is needed; for "
            "a machine that was released without any, give a model without actuators"
        )
    moves = [
        np.nanstd(column) > _STILL
        for name, column in recording.columns.items()
        if name.startswith(("ctrl/", "qpos/"))
    ]
    commands = [
        np.nanstd(recording.columns[f"ctrl/{d.name}"]) > _STILL
        for d in scene.drives
        if f"ctrl/{d.name}" in recording.columns
    ]
    if not any(moves) and not actuators:
        raise RecordingError(
            "nothing moves, so nothing can be learned; record how the machine moves when it is "
            "released away from rest"
        )
    if not any(moves) or (commands and not any(commands) and not _swings(scene, recording)):
        raise RecordingError(
            "every command is constant and nothing moves: nothing is excited, so nothing can be "
            "learned; record a motion, for example the one of --suggest-experiment"
        )


def _completed(scene: Scene, recording: Recording) -> Recording:
    """A recording with the pose of every base that floats."""
    columns, computed = dict(recording.columns), list[str]()
    for joint in scene.free:
        if pose := located(scene, joint, stamps(recording), columns):
            columns |= pose
            computed.append(joint)
    return replace(recording, columns=columns, meta={**recording.meta, ESTIMATED: tuple(computed)})


def _swings(scene: Scene, recording: Recording) -> bool:
    """Tell whether some joint moves although no command does, as a released pendulum."""
    return any(
        np.nanstd(recording.columns.get(f"qpos/{joint}", np.zeros(1))) > 0.02
        for joint in scene.joints
    )


def _cut(part: Part) -> tuple[list[Part], list[Part]]:
    """The first three quarters and the last of one recording."""
    cut = (1.0 - _HELD_SHARE) * part.recording.seconds
    return (
        [Part(part.recording, part.index, (0.0, cut))],
        [Part(part.recording, part.index, (cut, np.inf))],
    )
