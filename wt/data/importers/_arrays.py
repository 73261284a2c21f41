"""Arrays by their names as a recording: what NumPy's and MATLAB's archives share.

Without a map, arrays are taken by their names: ``t`` (or ``time``, ``timestamps``) in seconds, any
recording column (``qpos/hip``), and the tables ``qpos``, ``qvel``, ``ctrl``, ``force`` of shape
(N, k) with the k names in the string arrays ``joints`` and ``actuators`` (``joints`` if left out).

Map::

    time: {array: stamp_us, scale: 1e-6}       # scale to seconds, 1 if left out
    columns:                                   # recording column: array, or one of its columns
      ctrl/shoulder: {array: cmd, index: 0}
      qpos/shoulder: angle

Keys that every format has (joints, units, signs, …) stand in :mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Shaped

from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.errors import DataError, suggest
from wt.types import Recording

KEYS = frozenset({"time", "columns"})
_TIMES = ("t", "time", "timestamps")
_NAMES = {"qpos": "joints", "qvel": "joints", "ctrl": "actuators", "force": "actuators"}

Arrays = Mapping[str, Shaped[np.ndarray, " ..."]]


def recording(path: Path, arrays: Arrays, mapping: Map, format: str) -> Recording:
    """Arrays as a recording.

    Args:
        path: where they are from, for messages.
        arrays: by their names.
        mapping: see the module.
        format: name of the importer.

    Raises:
        DataError: an array is missing or has another shape.
    """
    time_names = [name for name in _TIMES if name in arrays]
    time = mapping.get("time", time_names[0] if time_names else None)
    if time is None:
        raise DataError(
            f"'{path}' has no array {', '.join(_TIMES)} but {', '.join(arrays)}; name one in "
            "the map with 'time: {array: …}'"
        )
    wanted = mapping.get("columns")
    if wanted is not None and not isinstance(wanted, Mapping):
        raise DataError("map columns must be '<recording column>: <array>' lines")
    columns = (
        _by_name(path, arrays)
        if wanted is None
        else {str(name): _picked(path, arrays, entry) for name, entry in wanted.items()}
    )
    meta = {"source": path.name, "format": format}
    return Recording(_picked(path, arrays, time), columns, meta)


def _by_name(path: Path, arrays: Arrays) -> dict[str, Float64[np.ndarray, " _"]]:
    columns = {}
    for name, array in arrays.items():
        kind, slash, _ = name.partition("/")
        if slash and kind in (*_NAMES, "sensor"):
            columns[name] = _picked(path, arrays, name)
        elif name in _NAMES:
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
    refuse_unknown_keys(entry, {"array", "index", "scale"})
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
    scaled: np.ndarray = float(scale) * array.astype(np.float64)
    return scaled
