"""The form of a map: one row a column of the log, and the content of ``wt import --map``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import yaml

from wt.check.finding import AuditFinding
from wt.data.guess.propose import propose
from wt.data.importers import _mapping, base
from wt.data.importers._survey import Surveyor
from wt.data.importers.base import UNITS, Map
from wt.errors import DataError, RecordingError, UserError
from wt.types import Recording

TIME = "t"
_ENTRY = re.compile(r"\b(joints|commands|units|signs|offsets): (\{[^{}…]*\}|[\w.]+)")
"""What an audit's fix says of a map, but for what it leaves open (…)."""


@dataclass(frozen=True)
class Row:
    """What becomes of one column of a log.

    Attributes:
        source: its name in the log.
        entry: how a map names it, in a table.
        channel: its name in the recording; None leaves it out.
        unit: a word of a map's ``units``.
        factor: to that unit.
        reversed: whether its sign is turned.
        offset: added in SI.
    """

    source: str
    channel: str | None
    unit: str = "SI"
    factor: float = 1.0
    reversed: bool = False
    offset: float = 0.0
    entry: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Form:
    """All rows of a log.

    Attributes:
        table: whether its columns have names of their own, which a map has to translate.
        rows: one a column.
        timed: whether a map names no time.
        rate: of the samples, where no row is the time [Hz].
    """

    table: bool
    rows: tuple[Row, ...]
    timed: bool = True
    rate: float | None = None


def offered(log: Path) -> Form:
    """A log's columns as they stand: under their channels, or in a table that a map translates.

    Raises:
        UserError: the log cannot be read.
    """
    importer = base.importer_of(log)
    try:
        return Form(False, tuple(Row(n, n) for n in read(log, {}, even_if=True)[0].columns))
    except (DataError, RecordingError):
        if not isinstance(importer, Surveyor):
            raise
    survey = importer.survey(log, {})
    rows = tuple(Row(q.name, None, entry=dict(q.entry)) for q in survey.quantities)
    return Form(True, rows, survey.timed)


def guessed(log: Path, form: Form, model: mujoco.MjModel | None) -> tuple[Form, list[str]]:
    """A table's columns as ``wt import --guess`` believes them to be, with its doubts."""
    proposal = propose(log, model)
    return filled(form, proposal.mapping), list(dict.fromkeys(proposal.doubts))


def filled(form: Form, mapping: Map) -> Form:
    """The form with what a map says.

    Args:
        form: of the log as it stands.
        mapping: from :func:`content`, or a guess.
    """
    if not form.table:
        channels = _mapping.renames([row.source for row in form.rows], mapping)
        return replace(form, rows=tuple(_filled(r, channels[r.source], mapping) for r in form.rows))
    columns = mapping.get("columns", {})
    channels = _mapping.renames(columns, mapping)
    time = mapping.get("time", {})
    rows = []
    for row in form.rows:
        target = next((n for n, wanted in columns.items() if _names(wanted, row)), None)
        if time and _names(time, row):
            scale = time.get("scale", 1.0) if isinstance(time, Mapping) else 1.0
            rows.append(replace(row, channel=TIME, factor=float(scale)))
        else:
            rows.append(_filled(row, channels.get(str(target)), mapping))
    rate = time.get("rate") if isinstance(time, Mapping) else None
    return replace(form, rows=tuple(rows), rate=None if rate is None else float(rate))


def _names(wanted: object, row: Row) -> bool:
    """Tell whether an entry of a map names a row."""
    if isinstance(wanted, Mapping):
        return {k: v for k, v in wanted.items() if k != "scale"} == row.entry
    return wanted in row.entry.values() and len(row.entry) == 1


def _filled(row: Row, channel: str | None, mapping: Map) -> Row:
    if channel is None:
        return replace(row, channel=None)
    unit = mapping.get("units", {}).get(channel, "SI")
    word, factor = (unit, 1.0) if isinstance(unit, str) else ("SI", float(unit))
    return replace(
        row,
        channel=channel,
        unit=word,
        factor=factor,
        reversed=mapping.get("signs", {}).get(channel, 1) == -1,
        offset=float(mapping.get("offsets", {}).get(channel, 0.0)),
    )


def proposed(form: Form, findings: Iterable[AuditFinding]) -> Form:
    """The form with what an audit says should be in the map.

    Args:
        form: that the audited recording was made with.
        findings: of the audit; those that are not sure change nothing.
    """
    rows = form.rows
    for finding in findings:
        for key, text in _ENTRY.findall(finding.fix) if finding.sure else ():
            entries = yaml.safe_load(text)
            rows = tuple(
                _amended(row, key, entries) if row.channel in finding.columns else row
                for row in rows
            )
    return replace(form, rows=rows)


def _amended(row: Row, key: str, entries: Any) -> Row:  # noqa: ANN401 – as YAML gives it
    channel = str(row.channel)
    kind, _, name = channel.partition("/")
    if key in ("joints", "commands"):
        fits = kind in (("ctrl",) if key == "commands" else ("qpos", "qvel"))
        return replace(row, channel=f"{kind}/{entries[name]}") if fits and name in entries else row
    value = entries.get(channel) if isinstance(entries, Mapping) else entries
    if value is None:
        return row
    if key == "offsets":
        return replace(row, offset=row.offset + float(value))
    if key == "signs":
        return replace(row, reversed=not row.reversed, offset=-row.offset)
    factor = UNITS[value] if value in UNITS else float(value)
    amended = replace(row, offset=factor * row.offset)
    if value in UNITS and (row.unit, row.factor) == ("SI", 1.0):
        return replace(amended, unit=value)
    return replace(amended, factor=factor * row.factor)


def content(form: Form) -> dict[str, Any]:
    """The map that a form says; empty if it changes nothing.

    Raises:
        UserError: two columns of a log would be the same channel, or a table has no time.
    """
    _refuse_twice(form.rows)
    kept = [r for r in form.rows if r.channel is not None and r.channel != TIME]
    said: dict[str, Any] = {}
    if form.table:
        if not form.timed:
            said["time"] = _time(form)
        said["columns"] = {str(r.channel): dict(r.entry) for r in kept}
    else:
        said["channels"] = {r.source: r.channel for r in form.rows if r.channel != r.source}
    said["units"] = {str(r.channel): _unit(r) for r in kept if _unit(r) != "SI"}
    said["signs"] = {str(r.channel): -1 for r in kept if r.reversed}
    said["offsets"] = {str(r.channel): r.offset for r in kept if r.offset}
    return {key: value for key, value in said.items() if value}


def _time(form: Form) -> dict[str, Any]:
    for row in form.rows:
        if row.channel == TIME:
            return {**row.entry, "scale": row.factor}
    if form.rate is None:
        raise UserError("no column is the time: choose 't' for one of them, or give the rate")
    return {"rate": form.rate}


def _unit(row: Row) -> str | float:
    return row.unit if row.factor == 1.0 else UNITS[row.unit] * row.factor


def _refuse_twice(rows: Sequence[Row]) -> None:
    taken: dict[str, str] = {}
    for row in rows:
        if row.channel is None:
            continue
        if row.channel in taken:
            raise UserError(
                f"'{taken[row.channel]}' and '{row.source}' are both to be {row.channel}; give one "
                "of them another channel, or leave it out"
            )
        taken[row.channel] = row.source


def parsed(form: Form, fields: Mapping[str, str]) -> Form:
    """The form as it was filled in.

    Args:
        form: of the log as it stands.
        fields: of the page, ``rate``, ``channel.0``, ``unit.0``, …; "" for a channel leaves it
            out, for a number it is the one that changes nothing.

    Raises:
        UserError: a field is missing, or no number or unit.
    """
    rate = fields.get("rate") or None
    return replace(
        form,
        rows=tuple(_parsed(i, row, fields) for i, row in enumerate(form.rows)),
        rate=None if rate is None else _number("samples", "rate", rate),
    )


def _parsed(index: int, row: Row, fields: Mapping[str, str]) -> Row:
    unit = fields.get(f"unit.{index}", "SI")
    if f"channel.{index}" not in fields or unit not in UNITS:
        raise UserError(f"the form has no channel or unit for '{row.source}'; reload the page")
    return replace(
        row,
        channel=fields[f"channel.{index}"] or None,
        unit=unit,
        factor=_number(row.source, "factor", fields.get(f"factor.{index}") or "1"),
        reversed=f"reversed.{index}" in fields,
        offset=_number(row.source, "offset", fields.get(f"offset.{index}") or "0"),
    )


def _number(source: str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if (
        not math.isfinite(value)
        or (what == "factor" and value == 0.0)
        or (what == "rate" and value <= 0.0)
    ):
        raise UserError(f"the {what} of '{source}' is {text[:20]!r}; give a number")
    return value


def read(log: Path, mapping: Map, even_if: bool = False) -> tuple[Recording, str]:
    """A log as a recording.

    Args:
        log: the file or folder.
        mapping: its map.
        even_if: whether columns may contradict each other.

    Returns:
        It, and what contradicts what, if anything does.

    Raises:
        UserError: it cannot be read so.
    """
    try:
        recording = base.mapped(log, mapping)
    except RecordingError as error:
        raise RecordingError(f"'{log}': {error}") from error
    try:
        base.refuse_contradictions(log, recording, mapping)
    except DataError as error:
        if not even_if:
            raise
        return recording, str(error)
    return recording, ""
