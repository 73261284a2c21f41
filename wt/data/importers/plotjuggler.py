"""CSV files that PlotJuggler exports: ``__time`` first, a cell left empty where nothing came.

Its header and rows are those of ``StatePublisherCSV`` (github.com/PlotJuggler/PlotJuggler); every
column has times of its own. What a topic of JointStates becomes there is read without a map
(``<topic>/<joint>/position``, ``/velocity``, ``/effort``): state and commands by the topic's name,
as in :mod:`wt.data.importers._topics`.

Map (all optional)::

    columns: {qpos/hip: "/lowstate/motor_state[0]/q"}   # or {column: …, scale: …, offset: …}
    join: {"ctrl/*": {how: held, tolerance: 0.1}}       # see wt.data.importers._clock

Keys that every format has (units, signs, meta, …) stand in :mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float64

from wt.data.importers import _csv, csv_table
from wt.data.importers._clock import Stream, joined
from wt.data.importers._mapping import Map
from wt.data.importers._survey import Survey
from wt.data.importers._topics import COMMANDS
from wt.data.importers.base import register
from wt.errors import DataError
from wt.types import Recording

_TIME = "__time"
_JOINT_STATE = re.compile(r"(?P<topic>/?.+)/(?P<joint>[^/]+)/(?P<field>position|velocity|effort)")
_KINDS = {"position": "qpos", "velocity": "qvel", "effort": "force"}
_SECOND = 1e9  # ns

Column = Float64[np.ndarray, " row"]


@register
class PlotJuggler:
    """Reads one export."""

    name: ClassVar[str] = "plotjuggler"
    about: ClassVar[str] = "a .csv file that PlotJuggler exported"
    keys: ClassVar[frozenset[str]] = frozenset({"columns", "join"})
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is a CSV file whose first column is PlotJuggler's time."""
        try:
            with path.open("rb") as file:
                return path.suffix.lower() == ".csv" and file.read(16).startswith(b"__time,")
        except OSError:
            return False

    def read(self, path: Path, mapping: Map) -> Recording:
        """The export as a recording.

        Raises:
            DataError: it is no whole table, or the map does not fit it.
        """
        table = _csv.read(path)
        t = csv_table.picked(path, table, _TIME)
        columns = _joint_states(table) | _mapped(path, table, mapping.get("columns", {}))
        if not np.isfinite(t).all() or (np.diff(t) < 0.0).any() or np.abs(t).max() > 9e9:
            raise DataError(f"'{path}': column '{_TIME}' is not seconds that never run backwards")
        stamps = np.round(t * _SECOND).astype(np.int64)
        measured = {n: x for n, x in columns.items() if n.startswith("qpos/")}
        if not measured:
            raise DataError(
                f"'{path}' has no position of a joint that PlotJuggler names; name it in the map "
                "with 'columns: {qpos/<joint>: <column>}'; 'wt import --guess' proposes one"
            )
        primary = max(measured.values(), key=lambda values: np.isfinite(values).sum())
        rows = np.isfinite(primary)
        # two rows of one time are one sample
        rows[:-1] &= (np.diff(stamps) > 0) | ~rows[1:]
        streams = [_stream(stamps, name, values) for name, values in columns.items()]
        on_clock = joined(streams, stamps[rows], mapping.get("join"))
        meta = {"source": path.name, "format": self.name}
        return Recording(t[rows] - t[rows][0], on_clock, meta)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The numeric columns of the export.

        Raises:
            DataError: it cannot be read as a table.
        """
        found = csv_table.quantities(_csv.read(path))
        return Survey([q for q in found if q.name != _TIME], timed=True)


def _stream(stamps: np.ndarray, name: str, values: Column) -> Stream:
    """A column's own samples; of equal times the last counts."""
    known = np.isfinite(values)
    own, first = np.unique(stamps[known][::-1], return_index=True)
    return Stream(own, {name: values[known][::-1][first]})


def _joint_states(table: _csv.Table) -> dict[str, Column]:
    """The columns that a topic of JointStates became."""
    found = [(_JOINT_STATE.fullmatch(q.name), q) for q in csv_table.quantities(table)]
    columns: dict[str, Column] = {}
    # of a command with several fields the first counts: position, else velocity, else effort
    for field, measured in _KINDS.items():
        for match, quantity in found:
            if match is not None and match["field"] == field:
                kind = "ctrl" if COMMANDS.search(match["topic"]) else measured
                columns.setdefault(f"{kind}/{match['joint']}", quantity.values)
    return columns


def _mapped(path: Path, table: _csv.Table, wanted: object) -> dict[str, Column]:
    if not isinstance(wanted, Mapping):
        raise DataError("map columns must be '<recording column>: <csv column>' lines")
    entries = {str(name): entry for name, entry in wanted.items() if entry is not None}
    return {name: csv_table.picked(path, table, entry) for name, entry in entries.items()}
