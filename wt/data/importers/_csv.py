"""Tables in text: what the importers of CSV files share."""

from __future__ import annotations

import codecs
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from jaxtyping import Float64
from pyarrow import csv

from wt.data import recording as recordings
from wt.errors import DataError

Table = Mapping[str, pa.ChunkedArray]
"""Columns of text by their names, all of one length."""

_HEADER, _BLOCK = 1 << 20, 1 << 22  # bytes of a header that are looked at, and read at a time
_KINDS = (pa.float64(), pa.bool_(), pa.timestamp("ns"), pa.timestamp("ns", "UTC"))
_NUMBER = r"^[+-]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|inf)$"


def read(path: Path) -> Table:
    """The table in a file with a header line, whatever separates its columns.

    A last line that is cut off, as a logger leaves it that was killed, is left out.

    Raises:
        DataError: it cannot be read as a table.
    """
    recordings.refuse_too_much(path, path.stat().st_size)
    short: list[csv.InvalidRow] = []

    def left_out(row: csv.InvalidRow) -> str:
        short.append(row)
        return "skip"

    try:
        with path.open("rb") as file:
            header, decoder = file.readline(_HEADER), codecs.getincrementaldecoder("utf-8")()
            for part in (header, *iter(lambda: file.read(_BLOCK), b"")):
                decoder.decode(part)  # a line that is left out is not read as text before
        between = max(b",;\t", key=lambda sign: header.count(bytes([sign])))
        parsed = csv.ParseOptions(delimiter=chr(between), invalid_row_handler=left_out)
        # one thread, so that a row knows its number
        read = csv.ReadOptions(use_threads=False, block_size=_BLOCK)
        with csv.open_csv(path, read, parsed) as opened:
            names = opened.schema.names
        # as text: a type that is guessed from the first rows may not be that of the others
        text = csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True
        )
        short.clear()
        table = csv.read_csv(path, read, parsed, text)
    except (ValueError, OSError) as error:
        raise DataError(f"'{path}' cannot be read as CSV: {error}") from error
    for row in short:
        if row.actual_columns > row.expected_columns or row.number < table.num_rows + 2:
            raise DataError(
                f"'{path}' cannot be read as CSV: line {row.number} has {row.actual_columns} "
                f"values where the header has {row.expected_columns}"
            )
    return dict(zip(_told_apart(names), table.columns, strict=True))


def numbers(column: pa.ChunkedArray) -> Float64[np.ndarray, " row"]:
    """A column as numbers: dates as seconds since 1970, NaN where it holds something else."""
    column = pc.utf8_trim_whitespace(column)
    for kind in _KINDS:
        try:
            read = pc.cast(column, kind)
        except pa.ArrowInvalid:
            continue
        break
    else:
        known = pc.match_substring_regex(column, _NUMBER)
        read = pc.cast(pc.if_else(known, pc.utf8_ltrim(column, "+"), None), pa.float64())
    if pa.types.is_timestamp(read.type):
        nanoseconds = pc.cast(read, pa.int64())
        read = pc.divide(pc.cast(nanoseconds, pa.float64(), safe=False), 1e9)
    values: np.ndarray = read.cast(pa.float64()).to_numpy()
    return values


def _told_apart(names: list[str]) -> list[str]:
    """The names of columns, those that stand there again with a number."""
    seen: dict[str, int] = {}
    told = []
    for name in map(str.strip, names):
        again = seen.get(name, 0)
        seen[name] = again + 1
        told.append(f"{name}.{again}" if again else name)
    return told
