"""What runs in a process of its own: each work by the functions of the command that it stands for.

A work is a function of plain arguments whose result is plain too (JSON), and which is called in
the session's folder, so that files have the names there that commands would give them.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml

from wt.check.files import Audited, audit, merged, outputs
from wt.check.page import figures, grid, page
from wt.data import recording as recordings
from wt.data.importers import base
from wt.data.importers.base import Map
from wt.diagnose.pace import Expected
from wt.diagnose.pipeline import diagnose as search
from wt.diagnose.report.write import claimed
from wt.diagnose.result import Stage
from wt.diagnose.selection.decisions import DecisionLog
from wt.errors import WTError
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.physics.spread import over
from wt.show.files import write_whole
from wt.studio import mapping as maps
from wt.studio import session, uploads

Send = Callable[[dict[str, Any]], None]
"""Tells the page what is being done."""
DRAWN = ("qpos", "qvel", "ctrl")
"""Kinds of channels whose curves are drawn."""


def unpack(send: Send, archive: str, limit: int) -> list[str]:
    """Unpack a .zip that was dropped; what came out."""
    return uploads.unpack(Path(archive), Path(), limit)


def check(send: Send, model: str | None, logs: Sequence[dict[str, str]]) -> dict[str, Any]:
    """``wt import`` of each log that needs it, and ``wt check`` of all.

    Args:
        send: told what is being done.
        model: the model's file, if there is one; logs are checked alone if it cannot be read.
        logs: of each its file ``log``, its ``map`` and its ``recording``, whether or not they are.

    Returns:
        ``errors``, a line each; ``findings`` as in ``diagnosis.json``; by log its ``forms``, those
        that are ``proposed``, its ``figures``, and the ``doubts`` of a map that was guessed;
        ``channels`` of the model; ``checked``, the recordings that can be diagnosed; ``page``, the
        file that was written, or None.
    """
    errors: list[str] = []
    scene: Scene | None = None
    audited: list[Audited] = []
    forms, proposed, drawn = dict[str, Any](), dict[str, Any](), dict[str, str]()
    doubts = dict[str, list[str]]()
    if model is not None:
        with _noted(errors):
            scene = Scene(model)
    given = None if scene is None else scene.path
    for number, each in enumerate(logs):
        log = each["log"]
        send({"step": f"checking {log}", "share": number / len(logs)})
        with _noted(errors):
            form = maps.offered(Path(log))
            forms[log] = asdict(form)  # as it stands, should its map be broken
            if form.table and not Path(each["map"]).is_file():
                form, doubts[log] = maps.guessed(Path(log), form, scene.given if scene else None)
                forms[log] = asdict(form)
                continue
            form = maps.filled(form, _map(each))
            forms[log] = asdict(form)
            (one,) = audit(given, [_recording(each)])
            audited.append(one)
            if (better := maps.proposed(form, one.findings)) != form:
                proposed[log] = asdict(better)
            drawn[log] = grid(figures(scene, replace(one, corrected=one.given), DRAWN))
    if given is not None and not logs:
        audited += audit(given, [])
    written: Path | None = None
    if audited:
        with outputs(Path(session.CHECK)) as into:
            written = into.page(page(given, audited))
    return {
        "errors": errors,
        "findings": [f.to_json() | {"sure": f.sure} for f in merged(audited)],
        "forms": forms,
        "proposed": proposed,
        "doubts": doubts,
        "figures": drawn,
        "channels": [] if scene is None else sorted(recordings.column_names(scene.given)),
        "checked": [str(a.path) for a in audited if a.path is not None],
        "page": None if written is None else str(written),
    }


@contextlib.contextmanager
def _noted(errors: list[str]) -> Iterator[None]:
    """Take note of what is wrong with a file, and go on with the others."""
    try:
        yield
    except WTError as error:
        errors.append(str(error))


def _map(each: dict[str, str]) -> Map:
    return base.read_map(each["map"]) if Path(each["map"]).is_file() else {}


def _recording(each: dict[str, str]) -> Path:
    """The recording of a log, which is made first where it is not one."""
    log, target = Path(each["log"]), Path(each["recording"])
    if target != log:
        recordings.write(maps.read(log, _map(each))[0], target)
    return target


def curves(send: Send, model: str | None, log: str, fields: dict[str, str]) -> dict[str, Any]:
    """The channels under a map that is being made, against the model's replay of the commands."""
    form = maps.parsed(maps.offered(Path(log)), fields)
    recording, line = maps.read(Path(log), maps.content(form), even_if=True)
    scene = Scene(model) if model else None
    if scene is not None:
        recordings.check_names(recording, scene.given)
    drawn = figures(scene, Audited(Path(log), recording, recording, ()), DRAWN)
    return {"figures": grid(drawn), "line": line}


def keep_map(send: Send, log: str, fields: dict[str, str], others: dict[str, str]) -> list[str]:
    """Write the map of a log, and of others with the same columns; none if it changes nothing.

    Args:
        send: not needed.
        log: whose form it is.
        fields: of the page.
        others: the map's file by log, that of ``log`` among them.

    Returns:
        The logs whose map it is.
    """
    form = maps.offered(Path(log))
    content = maps.content(maps.parsed(form, fields))
    same = [each for each in others if each == log or _alike(form, Path(each))]
    for each in same:
        if content:
            text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
            write_whole(Path(others[each]), text)
        else:
            Path(others[each]).unlink(missing_ok=True)
    return same


def _alike(form: maps.Form, log: Path) -> bool:
    try:
        return maps.offered(log) == form
    except WTError:
        return False


def diagnose(
    send: Send, model: str, fitted: Sequence[str], held: Sequence[str], out: str
) -> dict[str, Any]:
    """``wt diagnose``, and of each step what is tried and what is the best so far."""
    folder, inputs = Path(out), [Path(p) for p in (model, *fitted, *held)]

    def progress(step: str, share: float) -> None:
        send({"step": step, "share": share})

    def expect(expected: Expected) -> None:
        send({"expected": str(expected)})

    with over(None), warnings.catch_warnings(), claimed(folder, inputs) as write:
        warnings.simplefilter("ignore", RuntimeWarning)
        warnings.simplefilter("ignore", UserWarning)
        diagnosis = search(
            model, fitted, held, progress=progress, expect=expect, log=_Watched(send)
        )
        progress("writing", 0.98)
        write(diagnosis)
    return {"out": out, "verdict": diagnosis.verdict}


class _Watched(DecisionLog):
    """Tells what is being replayed, and each decision on it as it is taken."""

    def __init__(self, send: Send) -> None:
        super().__init__()
        self._send = send

    def trying(self, hypotheses: Sequence[Planted], leading: Planted | None = None) -> None:
        names = dict.fromkeys(_said(h) for h in hypotheses)
        self._send({"trying": list(names), "leading": _said(leading) if leading else ""})

    def add(
        self,
        planted: Planted,
        stage: Stage,
        kept: bool,
        statistic: float,
        threshold: float,
        reason: str,
    ) -> None:
        super().add(planted, stage, kept, statistic, threshold, reason)
        if stage == "screened":
            return  # of thousands, without a replay
        joined: dict[str, None] = {}
        for d in self:
            name = f"{d.effect} at {d.at}"
            if d.kept:
                joined[name] = None
            elif d.stage in ("pruned", "reconsidered"):
                joined.pop(name, None)
        tried = sum(d.stage in ("replayed", "joined") for d in self)
        said = f"{_said(planted)}: {'joins' if kept else reason}"
        self._send({"tried": tried, "best": list(joined), "leading": "", "said": said})


def _said(planted: Planted) -> str:
    return f"{planted.effect.id} at {planted.at}"


WORKS: dict[str, Callable[..., Any]] = {
    work.__name__: work for work in (unpack, check, curves, keep_map, diagnose)
}
"""By name."""
