"""A plain CSV table with one column a quantity; a map says which is which.

Map::

    time: {column: stamp_us, scale: 1e-6}        # scale to seconds, 1 if left out
    columns:                                     # recording column: CSV column
      ctrl/shoulder: cmd
      qpos/shoulder: {column: angle_deg, scale: 0.017453292519943295, offset: 0.0}

Keys that every format has (units, signs, meta, …) stand in :mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from jaxtyping import Float64

from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.data.importers.base import register
from wt.errors import DataError, suggest
from wt.types import Recording


@register
class CsvTable:
    """Reads one CSV file with a header line."""

    name: ClassVar[str] = "csv_table"
    about: ClassVar[str] = "a .csv file with a header (needs --map)"
    keys: ClassVar[frozenset[str]] = frozenset({"time", "columns"})
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
                "{qpos/<joint>: <csv column>, …}'; give it with --map F.yaml"
            )
        try:
            table = pd.read_csv(path)
        except (ValueError, OSError) as error:
            raise DataError(f"'{path}' cannot be read as CSV: {error}") from error
        columns = {name: _column(path, table, w) for name, w in mapping["columns"].items()}
        meta = {"source": path.name, "format": self.name}
        return Recording(_column(path, table, mapping["time"]), columns, meta)


def _column(path: Path, table: pd.DataFrame, wanted: object) -> Float64[np.ndarray, " row"]:
    entry: dict[str, Any] = wanted if isinstance(wanted, dict) else {"column": wanted}
    refuse_unknown_keys(entry, {"column", "scale", "offset"})
    name = str(entry.get("column"))
    if name not in table:
        raise DataError(f"'{path}' has no column {name!r}: {suggest(name, map(str, table))}")
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(np.float64)
    if not np.isfinite(values).any():
        raise DataError(f"'{path}': column {name!r} holds no numbers")
    try:
        scale, offset = float(entry.get("scale", 1.0)), float(entry.get("offset", 0.0))
    except (TypeError, ValueError) as error:
        raise DataError(f"map: scale and offset of {name!r} must be numbers: {error}") from error
    # SI value = scale · raw + offset
    return scale * values + offset
