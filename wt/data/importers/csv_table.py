"""A plain CSV table with one column a quantity; a map says which is which.

Map::

    time: {column: stamp_us, scale: 1e-6}        # scale to seconds, 1 if left out; or {rate: 50}
    columns:                                     # recording column: CSV column
      ctrl/shoulder: cmd
      qpos/shoulder: {column: angle_deg, scale: 0.017453292519943295, offset: 0.0}
      sensor/gyro/0: {column: gyro_x, time: {column: imu_us, scale: 1e-6}}   # its own clock
    join: {"sensor/*/*": {how: nearest, tolerance: 0.01}}   # see wt.data.importers._clock

Columns may be separated by commas, semicolons or tabs. ``wt import --guess`` proposes a map. Keys
that every format has (units, signs, meta, …) stand in :mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float64

from wt.data.importers import _csv
from wt.data.importers._arrays import even
from wt.data.importers._clock import joined, nanoseconds, timed
from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.data.importers._survey import Quantity, Survey
from wt.data.importers.base import register
from wt.errors import DataError, suggest
from wt.types import Recording


@register
class CsvTable:
    """Reads one CSV file with a header line."""

    name: ClassVar[str] = "csv_table"
    about: ClassVar[str] = "a .csv file with a header (needs --map)"
    keys: ClassVar[frozenset[str]] = frozenset({"time", "columns", "join"})
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is a CSV file."""
        return path.is_file() and path.suffix.lower() == ".csv"

    def read(self, path: Path, mapping: Map) -> Recording:
        """The mapped columns as a recording.

        Raises:
            DataError: no map, a column that is not there, or one that is not numeric.
        """
        if "time" not in mapping or not isinstance(mapping.get("columns"), dict):
            raise DataError(
                f"'{path}' needs a map with 'time: {{column: …}}' and 'columns: "
                "{qpos/<joint>: <csv column>, …}'; give it with --map F.yaml; 'wt import "
                f"{path.name} --guess' proposes one"
            )
        table = _csv.read(path)
        wanted = {n: entry for n, entry in mapping["columns"].items() if entry is not None}
        columns = {name: picked(path, table, entry) for name, entry in wanted.items()}
        clocks = {n: e["time"] for n, e in wanted.items() if isinstance(e, dict) and "time" in e}
        own = [
            timed(name, picked(path, table, clock), columns.pop(name))
            for name, clock in clocks.items()
        ]
        time = mapping["time"]
        if isinstance(time, dict) and "rate" in time:
            refuse_unknown_keys(time, {"rate"})
            rows = len(next(iter(table.values()), ()))
            t = even(time["rate"], rows, "map time: rate")
        else:
            t = picked(path, table, time)
        if mapping.get("join") is not None and not own:
            raise DataError("map join is for columns with a 'time' of their own; none has one")
        columns |= joined(own, nanoseconds(t), mapping.get("join"))
        return Recording(t, columns, {"source": path.name, "format": self.name})

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The numeric columns of the table.

        Raises:
            DataError: it cannot be read as a table.
        """
        return Survey(list(quantities(_csv.read(path))))


def quantities(table: _csv.Table) -> Iterable[Quantity]:
    """The columns of a table that are numbers."""
    for name, column in table.items():
        values = _csv.numbers(column)
        if np.isfinite(values).any():
            yield Quantity(name, {"column": name}, values)


def picked(path: Path, table: _csv.Table, wanted: object) -> Float64[np.ndarray, " row"]:
    """One column of a table by a map's entry, scaled.

    Raises:
        DataError: it is not there, or is not numeric.
    """
    entry: dict[str, Any] = wanted if isinstance(wanted, dict) else {"column": wanted}
    refuse_unknown_keys(entry, {"column", "scale", "offset", "time"})
    name = str(entry.get("column"))
    if name not in table:
        raise DataError(f"'{path}' has no column {name!r}: {suggest(name, table)}")
    values = _csv.numbers(table[name])
    if not np.isfinite(values).any():
        raise DataError(f"'{path}': column {name!r} holds no numbers")
    try:
        scale, offset = float(entry.get("scale", 1.0)), float(entry.get("offset", 0.0))
    except (TypeError, ValueError) as error:
        raise DataError(f"map: scale and offset of {name!r} must be numbers: {error}") from error
    # SI value = scale · raw + offset
    return scale * values + offset
