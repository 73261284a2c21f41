"""Arrays by their names as a recording: what archives of arrays share.

Without a map, arrays are taken by their names: ``t`` (or ``time``, ``timestamps``) in seconds, any
recording column (``qpos/hip``), and the tables ``qpos``, ``qvel``, ``ctrl``, ``force`` of shape
(N, k) with the k names in the string arrays ``joints`` and ``actuators`` (``joints`` if left out);
or by a layout of :mod:`wt.data.importers._layouts`.

Map::

    time: {array: stamp_us, scale: 1e-6}       # scale to seconds, 1 if left out; or {rate: 50}
    columns:                                   # recording column: array, or one of its columns
      ctrl/shoulder: {array: cmd, index: 0}
      qpos/shoulder: angle
      sensor/gyro/0: {array: w, index: 0, time: {array: imu_us, scale: 1e-6}}  # its own clock
    join: {"sensor/*/*": {how: nearest, tolerance: 0.01}}

How quantities of another clock are joined stands in :mod:`wt.data.importers._clock`; keys that
every format has (joints, units, signs, …) in :mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float64, Shaped

from wt.data.importers._clock import Stream, joined, nanoseconds, timed
from wt.data.importers._layouts import Layout, layout_of
from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.data.importers._survey import Quantity, Survey
from wt.errors import DataError, suggest
from wt.types import Recording

KEYS = frozenset({"time", "columns", "join"})
_TIMES = ("t", "time", "timestamps")
_NAMES = {"qpos": "joints", "qvel": "joints", "ctrl": "actuators", "force": "actuators"}
_JOINT_NAMES = ("joint_names", "dof_names", "joints")
_MOST_COLUMNS = 512  # of a table: what is wider is an image

Rate = Callable[[], float | None]
Arrays = Mapping[str, Shaped[np.ndarray, " ..."]]
"""Arrays by name; one that is not asked for need not be read."""


class ArrayImporter(abc.ABC):
    """Base of importers of files that are told by their suffix and hold arrays by their names."""

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    keys: ClassVar[frozenset[str]] = KEYS
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file by its name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    @abc.abstractmethod
    def arrays(self, path: Path) -> Arrays:
        """The arrays of a file.

        Raises:
            DataError: it is not whole, or holds more than numbers and words.
        """

    def read(self, path: Path, mapping: Map) -> Recording:
        """The arrays as a recording.

        Raises:
            DataError: the file is not whole, or an array is missing or has another shape.
        """
        return recording(path, self.arrays(path), mapping, self.name)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The rows of numbers among the arrays.

        Raises:
            DataError: the file is not whole.
        """
        return survey(self.arrays(path))


def recording(
    path: Path, arrays: Arrays, mapping: Map, format: str, rate: Rate = lambda: None
) -> Recording:
    """Arrays as a recording.

    Args:
        path: where they are from, for messages.
        arrays: by their names.
        mapping: see the module.
        format: name of the importer.
        rate: a rate that the file states elsewhere, for layouts without a time [Hz].

    Raises:
        DataError: an array is missing or has another shape.
    """
    wanted = mapping.get("columns")
    if wanted is not None and not isinstance(wanted, Mapping):
        raise DataError("map columns must be '<recording column>: <array>' lines")
    layout = None if wanted is not None else layout_of(arrays)
    meta: dict[str, object] = {"source": path.name, "format": format}
    own: list[Stream] = []
    if wanted is not None:
        own, columns = _mapped(path, arrays, wanted)
    elif layout is not None:
        columns = _laid_out(path, arrays, layout)
        assumed = list(layout.assumed)
        if "qpos/joint0" in columns:
            assumed.append("joints have no names in the file: joint0, joint1, … in its order")
        meta |= {"format": f"{format} ({layout.name})", "assumed": assumed}
    else:
        columns = _by_name(path, arrays)
    rows = max([len(values) for values in columns.values()], default=0)
    t = _time(path, arrays, mapping, layout, rows, rate)
    if own:
        columns |= joined(own, nanoseconds(t), mapping.get("join"))
    elif mapping.get("join") is not None:
        raise DataError("map join is for columns with a 'time' of their own; none has one")
    return Recording(t, columns, meta)


def survey(arrays: Arrays) -> Survey:
    """The rows of numbers among arrays."""
    quantities = []
    rate = None
    for name, array in arrays.items():
        if array.dtype.kind not in "fiub" or not 1 <= array.ndim <= 2:
            continue
        if array.size == 1 and name in ("fps", "rate", "hz"):
            rate = float(array.ravel()[0])
        if array.ndim == 1 and len(array) > 1:
            quantities.append(Quantity(name, {"array": name}, array.astype(np.float64)))
        elif array.ndim == 2 and len(array) > 1 and array.shape[1] <= _MOST_COLUMNS:
            quantities += [
                Quantity(f"{name}/{i}", {"array": name, "index": i}, array[:, i].astype(np.float64))
                for i in range(array.shape[1])
            ]
    return Survey(quantities, rate_hz=rate)


def _time(
    path: Path,
    arrays: Arrays,
    mapping: Map,
    layout: Layout | None,
    rows: int,
    rate: Rate,
) -> Float64[np.ndarray, " time"]:
    """Times [s]: by the map, else by the layout, else by an array's name."""
    entry = mapping.get("time")
    if isinstance(entry, Mapping) and "rate" in entry:
        refuse_unknown_keys(entry, {"rate"})
        return even(entry["rate"], rows, "map time: rate")
    if entry is not None:
        return _picked(path, arrays, entry)
    if layout is not None and layout.time is None:
        if layout.fps is not None:
            hz: object = float(np.ravel(arrays[layout.fps])[0])
        else:
            hz = layout.rate_hz or rate()
        if hz is None:
            raise DataError(
                f"'{path}' ({layout.name}) does not say how fast it was recorded; set in the map "
                "'time: {rate: <Hz>}'"
            )
        return even(hz, rows, f"'{path}': its rate")
    named = layout.time if layout else next((name for name in _TIMES if name in arrays), None)
    if named is None:
        raise DataError(
            f"'{path}' has no array {', '.join(_TIMES)} but {_some(arrays)}; name one in the map "
            "with 'time: {array: …}', or say 'time: {rate: <Hz>}'; 'wt import --guess' proposes one"
        )
    return _picked(path, arrays, named)


def even(rate: object, rows: int, what: str) -> Float64[np.ndarray, " time"]:
    """Times of rows at a rate [s].

    Args:
        rate: what was given for it [Hz].
        rows: how many.
        what: name of it, for the message.

    Raises:
        DataError: it is no rate.
    """
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0.0 < rate < 1e6:
        raise DataError(f"{what} is {rate!r}; it must be a number of Hz")
    return np.arange(rows) / float(rate)


def _mapped(
    path: Path, arrays: Arrays, wanted: Mapping[str, object]
) -> tuple[list[Stream], dict[str, Float64[np.ndarray, " _"]]]:
    """The map's columns: those with a clock of their own, and those on the recording's."""
    own, columns = [], {}
    for name, entry in wanted.items():
        if entry is None:
            continue
        clock = entry.get("time") if isinstance(entry, Mapping) else None
        values = _picked(path, arrays, entry)
        if clock is None:
            columns[str(name)] = values
            continue
        t = _picked(path, arrays, clock)
        if len(t) != len(values):
            raise DataError(f"map: {name!r} has {len(values)} samples and its time {len(t)}")
        own.append(timed(str(name), t, values))
    return own, columns


def _laid_out(path: Path, arrays: Arrays, layout: Layout) -> dict[str, Float64[np.ndarray, " _"]]:
    columns = {}
    for name, kind in layout.tables.items():
        if name not in arrays:
            continue
        width = arrays[name].shape[1] if arrays[name].ndim == 2 else 1
        for i, joint in enumerate(_joints(arrays, layout, width)):
            entry = {"array": name} | ({"index": i} if arrays[name].ndim == 2 else {})
            values = _picked(path, arrays, entry)
            if kind in layout.next_row:
                values = np.append(values[1:], np.nan)
            columns[f"{kind}/{joint}"] = values
    return columns


def _joints(arrays: Arrays, layout: Layout, width: int) -> Sequence[str]:
    """Names of a layout's joints."""
    for name in _JOINT_NAMES:
        listed = arrays.get(name)
        if listed is not None and listed.dtype.kind in "US" and listed.size == width:
            return [str(n) for n in listed.astype(str).ravel()]
    return layout.joints.get(width, [f"joint{i}" for i in range(width)])


def _by_name(path: Path, arrays: Arrays) -> dict[str, Float64[np.ndarray, " _"]]:
    columns = {}
    for name in arrays:
        kind, slash, _ = name.partition("/")
        if slash and kind in (*_NAMES, "sensor"):
            columns[name] = _picked(path, arrays, name)
        elif name in _NAMES:
            array = arrays[name]
            listed = arrays.get(_NAMES[name], arrays.get("joints"))
            width = array.shape[1] if array.ndim == 2 else 1
            if listed is None or listed.dtype.kind not in "US" or listed.size != width:
                raise DataError(
                    f"'{path}': array {name!r} of shape {array.shape} needs {width} names in a "
                    f"string array {_NAMES[name]!r}, or a map with 'columns: {{…}}'"
                )
            for i, foreign in enumerate(listed.astype(str).ravel()):
                entry = {"array": name} | ({"index": i} if array.ndim == 2 else {})
                columns[f"{name}/{foreign}"] = _picked(path, arrays, entry)
    return columns


def _picked(path: Path, arrays: Arrays, wanted: object) -> Float64[np.ndarray, " time"]:
    """One column of an array, scaled."""
    entry: dict[str, Any] = wanted if isinstance(wanted, dict) else {"array": wanted}
    refuse_unknown_keys(entry, {"array", "index", "scale", "time"})
    name = str(entry.get("array"))
    if name not in arrays:
        raise DataError(f"'{path}' has no array {name!r}: {suggest(name, arrays)}")
    array, index = arrays[name], entry.get("index")
    if index is not None and array.ndim == 2:
        if not isinstance(index, int) or not 0 <= index < array.shape[1]:
            raise DataError(f"map: index {index!r} of {name!r} must be 0…{array.shape[1] - 1}")
        array = array[:, index]
    if array.ndim != 1 or array.dtype.kind not in "fiub":
        raise DataError(
            f"'{path}': array {name!r} has shape {array.shape} of {array.dtype}; a column is "
            "one row of numbers: give 'index' in the map"
        )
    scale = entry.get("scale", 1.0)
    if isinstance(scale, bool) or not isinstance(scale, int | float):
        raise DataError(f"map: scale of {name!r} is {scale!r}; it must be a number")
    with np.errstate(over="ignore", invalid="ignore"):  # a recording refuses what is infinite
        scaled: np.ndarray = float(scale) * array.astype(np.float64)
    return scaled


def _some(names: Mapping[str, object]) -> str:
    listed = sorted(names)
    return ", ".join(listed[:12]) + (", …" if len(listed) > 12 else "") or "nothing"
