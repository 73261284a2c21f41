"""Episodes of LeRobot datasets, v2.0, v2.1 and v3: Parquet with lists of numbers, names in meta.

The layouts are those of github.com/huggingface/lerobot: in ``meta/info.json`` ``codebase_version``,
``fps`` and ``features``; up to v2.1 one file each (``data/chunk-000/episode_000000.parquet``),
in v3 several in one (``data/chunk-000/file-000.parquet``), found by ``meta/episodes``.

``action`` becomes commands, ``observation.state`` positions, ``observation.velocity`` and
``observation.effort`` velocities and forces. An element's name is that of its joint; an ending
``.pos``, ``.vel``, ``.effort`` or ``.torque`` says what it is, and other endings (``.x``, …) stay
part of the name. Where the dataset has no names, joints are ``joint0``, ``joint1``, ….
The action of a row is in force from that row on. LeRobot leaves units open (degrees, or percent
of the range): give ``units`` in the map, or the robot's calibration, which is looked for in the
dataset (``calibration/robots/<type>/<id>.json``, as LeRobot keeps it) and turns both into radians
(:mod:`wt.data.importers._calibration`).

Map (all optional)::

    episode: 3                # needed where there are several in the source
    calibration: arm.json     # of lerobot-calibrate; false for none
    unit: percent             # with a calibration: percent or degrees; left out, the values tell

Keys that every format has (joints, units, signs, …) stand in :mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float64

from wt.data import recording as recordings
from wt.data.importers import _calibration, _mapping
from wt.data.importers.base import Map, register
from wt.errors import DataError
from wt.types import Recording

_INFO = Path("meta") / "info.json"
_PLACE = ("data/chunk_index", "data/file_index")
_KINDS = {
    "action": "ctrl",
    "observation.state": "qpos",
    "observation.velocity": "qvel",
    "observation.effort": "force",
}
_ENDINGS = {".pos": None, ".vel": "qvel", ".effort": "force", ".torque": "force"}
"""Kind of an element of the state by the ending of its name; ``.pos`` changes nothing."""


@register
class LeRobot:
    """Reads one episode."""

    name: ClassVar[str] = "lerobot"
    about: ClassVar[str] = f"a dataset folder with {_INFO}, or one of its .parquet files"
    keys: ClassVar[frozenset[str]] = frozenset({"episode", "calibration", "unit"})
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a folder, or a Parquet file with an action."""
        if path.is_dir():
            return (path / _INFO).is_file()
        if path.suffix != ".parquet" or not path.is_file():
            return False
        try:
            return "action" in pq.read_schema(path).names
        except (pa.ArrowException, OSError, ValueError):
            return _dataset_of(path) is not None

    def read(self, path: Path, mapping: Map) -> Recording:
        """One episode as a recording; see the module for names and units.

        Raises:
            DataError: the dataset is broken, or the map does not say which episode.
        """
        folder = path if path.is_dir() else _dataset_of(path)
        info = _info(folder) if folder else {}
        wanted = mapping.get("episode")
        files = _files(path, info, wanted) if path.is_dir() else [path]
        table = _episode(path, files, wanted)
        if "timestamp" in table.column_names:
            t = table["timestamp"].to_numpy().astype(np.float64)
        elif isinstance(info.get("fps"), int | float):
            t = np.arange(len(table)) / info["fps"]
        else:
            raise DataError(f"'{path}' has neither a column 'timestamp' nor fps in {_INFO}")
        columns: dict[str, Float64[np.ndarray, " row"]] = {}
        for feature, kind in _KINDS.items():
            if feature in table.column_names:
                values = _lists(path, table, feature)
                names = _names(info, feature, values.shape[1])
                for name, column in zip(names, values.T, strict=True):
                    stem, what = _what(name, kind)
                    columns[f"{what}/{stem}"] = column
        meta: dict[str, object] = {"source": path.name, "format": self.name}
        meta |= {"robot": info.get("robot_type")}
        meta |= {"episode": int(table["episode_index"][0].as_py())}
        unit = mapping.get("unit")
        if unit not in (None, "percent", "degrees"):
            raise DataError(f"map unit is {unit!r}; it must be percent or degrees")
        calibration = _calibration.of_dataset(folder or path.parent, mapping.get("calibration"))
        if calibration is not None:
            columns, said = calibration.radians(columns, unit)
            meta |= {"assumed": [said]}
        elif unit is not None:
            raise DataError("map unit needs a calibration; without one give 'units'")
        return Recording(t, columns, meta)


def _dataset_of(file: Path) -> Path | None:
    return next((p for p in file.resolve().parents if (p / _INFO).is_file()), None)


def _info(folder: Path) -> dict[str, Any]:
    try:
        content = json.loads((folder / _INFO).read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError(f"holds {type(content).__name__}")
        return content
    except (ValueError, OSError) as error:
        raise DataError(f"'{folder / _INFO}' is not a whole JSON object: {error}") from error


def _files(folder: Path, info: dict[str, Any], episode: object) -> list[Path]:
    """The files in which an episode may be: the one that is named after it, or all.

    Raises:
        DataError: the dataset is of a version that is not read, or the episode is not given.
    """
    version = str(info.get("codebase_version", "v2"))
    if not version.startswith(("v2", "v3")):
        raise DataError(
            f"'{folder}' is of LeRobot's {version}; v2.0 to v3 are read: convert it with lerobot"
        )
    total = info.get("total_episodes")
    if episode is None and isinstance(total, int) and total > 1:
        raise DataError(
            f"'{folder}' holds {total} episodes, 0 to {total - 1}; choose one in the map with "
            "'episode: N', or give one episode's file"
        )
    files = sorted((folder / "data").rglob("*.parquet"))
    if not isinstance(episode, int):
        return files
    names = {f"episode_{episode:06d}.parquet"}
    for index in sorted((folder / "meta" / "episodes").rglob("*.parquet")):
        with suppress(pa.ArrowException, OSError, ValueError, KeyError):
            table = pq.read_table(index, columns=["episode_index", *_PLACE])
            row = table.filter(pa.compute.equal(table["episode_index"], episode)).to_pylist()
            names |= {f"chunk-{r[_PLACE[0]]:03d}/file-{r[_PLACE[1]]:03d}.parquet" for r in row}
    fitting = [file for file in files if any(file.as_posix().endswith(name) for name in names)]
    return fitting or files


def _episode(path: Path, files: list[Path], wanted: object) -> pa.Table:
    """The rows of one episode in time's order, over all files that hold some of it."""
    try:
        tables = [_known_columns(file) for file in files]
        episodes = sorted({e for table in tables for e in table["episode_index"].to_pylist()})
    except KeyError as error:
        raise DataError(f"'{path}' is no LeRobot dataset: it has no column {error}") from error
    except (pa.ArrowException, OSError, ValueError) as error:
        raise DataError(
            f"'{path}' is not whole Parquet (cut off, or only a pointer to it?): {error}"
        ) from error
    if not episodes:
        raise DataError(f"'{path}' holds no episode; download its data folder too")
    episode = _mapping.episode(path, episodes, wanted, ", or give one episode's file")
    parts = [t.filter(pa.compute.equal(t["episode_index"], episode)) for t in tables]
    table = pa.concat_tables(part for part in parts if len(part))
    return table.sort_by("frame_index") if "frame_index" in table.column_names else table


def _known_columns(file: Path) -> pa.Table:
    known = {*_KINDS, "timestamp", "episode_index", "frame_index"}
    names = [name for name in pq.read_schema(file).names if name in known]
    metadata = pq.read_metadata(file)
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    chunks = [group.column(i) for group in groups for i in range(group.num_columns)]
    sizes = [c.total_uncompressed_size for c in chunks if c.path_in_schema.startswith(tuple(names))]
    recordings.refuse_too_much(file, sum(sizes))
    table = pq.read_table(file, columns=names)
    if "episode_index" not in table.column_names:
        raise KeyError("episode_index")
    return table


def _lists(path: Path, table: pa.Table, feature: str) -> Float64[np.ndarray, "row element"]:
    """A feature's rows."""
    try:
        rows = np.array(table[feature].to_pylist(), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise DataError(f"'{path}': {feature} is not a list of numbers per row: {error}") from error
    if rows.ndim not in (1, 2):
        raise DataError(f"'{path}': {feature} is not a list of numbers per row")
    return rows[:, None] if rows.ndim == 1 else rows


def _names(info: dict[str, Any], feature: str, width: int) -> list[str]:
    """Names of a feature's elements: a list, or lists under headings like "motors"."""
    names: Any = info
    for key in ("features", feature, "names"):
        if not isinstance(names, dict):
            raise DataError(
                f"{_INFO}: {names!r} stands where {key!r} is looked for; features are "
                "'name: {names: …}'"
            )
        names = names.get(key, {} if key != "names" else None)
    if isinstance(names, dict) and all(isinstance(i, int) for i in names.values()):
        names = sorted(names, key=names.__getitem__)
    if isinstance(names, dict):
        names = [n for group in names.values() for n in (group if isinstance(group, list) else [])]
    if not isinstance(names, list) or len(names) != width:
        return [f"joint{i}" for i in range(width)]
    return [str(name) for name in names]


def _what(name: str, kind: str) -> tuple[str, str]:
    """Joint and kind of an element; an action is a command whatever its ending."""
    for ending, meant in _ENDINGS.items():
        if name.endswith(ending):
            stem = name.removesuffix(ending)
            return stem, kind if meant is None or kind == "ctrl" else meant
    return name, kind
