"""The form of a map: one row a column of the log, and the content of ``wt import --map``."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from wt.check.finding import AuditFinding
from wt.data.importers import base
from wt.data.importers.base import UNITS, Map
from wt.errors import DataError, RecordingError, UserError
from wt.types import Recording

TIME = "t"
_TABLE = "csv_table"
_ENTRY = re.compile(r"\b(joints|commands|units|signs|offsets): (\{[^{}…]*\}|[\w.]+)")
"""What an audit's fix says of a map, but for what it leaves open (…)."""
_HEAD = 2**16  # bytes in which the first line of a table ends


@dataclass(frozen=True)
class Row:
    """What becomes of one column of a log.

    Attributes:
        source: its name in the log.
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


@dataclass(frozen=True)
class Form:
    """All rows of a log.

    Attributes:
        table: whether its columns have names of their own, which a map has to translate.
        rows: one a column.
    """

    table: bool
    rows: tuple[Row, ...]


def offered(log: Path) -> Form:
    """A log's columns as they stand, each mapped to the channel of its name.

    Raises:
        UserError: the log cannot be read; a table needs no map for that.
    """
    importer = base.importer_of(log)
    if importer.name == _TABLE:
        return Form(True, tuple(Row(n, _channel_of(n)) for n in _header(log)))
    return Form(False, tuple(Row(n, n) for n in read(log, {}, even_if=True)[0].columns))


def _header(log: Path) -> list[str]:
    with log.open("rb") as file:
        line = file.readline(_HEAD)
    try:
        names = next(csv.reader([line.decode("utf-8-sig").strip()]), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"'{log}' cannot be read as CSV: {error}") from error
    return [n for n in names if n]


def _channel_of(name: str) -> str | None:
    """The channel that a table's column is, where its name says so."""
    if name.lower() in (TIME, "time", "timestamp"):
        return TIME
    kind, slash, rest = name.partition("/")
    return name if slash and rest and kind in ("qpos", "qvel", "ctrl", "force", "sensor") else None


def filled(form: Form, mapping: Map) -> Form:
    """The form with what a map of ours says.

    Args:
        form: of the log as it stands.
        mapping: from :func:`content`.
    """
    if form.table:
        targets = {_picked(w): name for name, w in mapping.get("columns", {}).items()}
        if "time" in mapping:
            targets[_picked(mapping["time"])] = TIME
        channels = {row.source: targets.get(row.source) for row in form.rows}
    else:
        named = mapping.get("channels", {})
        channels = {row.source: named.get(row.source, row.source) for row in form.rows}
    return Form(form.table, tuple(_filled(s, c, mapping) for s, c in channels.items()))


def _picked(wanted: object) -> str:
    return str(wanted["column"] if isinstance(wanted, Mapping) else wanted)


def _filled(source: str, channel: str | None, mapping: Map) -> Row:
    if channel is None:
        return Row(source, None)
    if channel == TIME:
        wanted = mapping["time"]
        scale = wanted.get("scale", 1.0) if isinstance(wanted, Mapping) else 1.0
        return Row(source, TIME, factor=float(scale))
    unit = mapping.get("units", {}).get(channel, "SI")
    word, factor = (unit, 1.0) if isinstance(unit, str) else ("SI", float(unit))
    turned = mapping.get("signs", {}).get(channel, 1) == -1
    return Row(source, channel, word, factor, turned, mapping.get("offsets", {}).get(channel, 0.0))


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
    return Form(form.table, rows)


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
        times = [r for r in form.rows if r.channel == TIME]
        if not times:
            raise UserError("no column is the time: choose 't' for one of them")
        said["time"] = {"column": times[0].source, "scale": times[0].factor}
        said["columns"] = {str(r.channel): r.source for r in kept}
    else:
        said["channels"] = {r.source: r.channel for r in form.rows if r.channel != r.source}
    said["units"] = {str(r.channel): _unit(r) for r in kept if _unit(r) != "SI"}
    said["signs"] = {str(r.channel): -1 for r in kept if r.reversed}
    said["offsets"] = {str(r.channel): r.offset for r in kept if r.offset}
    return {key: value for key, value in said.items() if value}


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
        fields: of the page, ``channel.0``, ``unit.0``, …; "" for a channel leaves it out, for a
            number it is the one that changes nothing.

    Raises:
        UserError: a field is missing, or no number or unit.
    """
    return Form(form.table, tuple(_parsed(i, r.source, fields) for i, r in enumerate(form.rows)))


def _parsed(index: int, source: str, fields: Mapping[str, str]) -> Row:
    unit = fields.get(f"unit.{index}", "SI")
    if f"channel.{index}" not in fields or unit not in UNITS:
        raise UserError(f"the form has no channel or unit for '{source}'; reload the page")
    return Row(
        source,
        fields[f"channel.{index}"] or None,
        unit,
        _number(source, "factor", fields.get(f"factor.{index}") or "1"),
        f"reversed.{index}" in fields,
        _number(source, "offset", fields.get(f"offset.{index}") or "0"),
    )


def _number(source: str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (what == "factor" and value == 0.0):
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
