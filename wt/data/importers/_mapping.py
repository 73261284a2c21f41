"""The part of a map that every format understands: names, units, signs, offsets and metadata.

Map (all optional)::

    joints: {panda_joint1: joint1, finger: null}  # joint name in the source: MJCF joint
    commands: {panda_joint1: motor1}              # … MJCF actuator; the joint's name if left out
    sensors: {imu_gyro: gyro}                     # sensor name in the source: MJCF sensor
    channels: {qpos/a: qpos/b, qvel/a: null}      # single columns, whatever their names say above
    units: deg                                    # all joint positions, velocities and commands
    signs: {ctrl/motor1: -1}
    offsets: {qpos/joint1: 0.1}
    drop: [sensor/temperature/*, force/*]         # columns that are left out
    meta: {robot: my arm, notes: …}

``null`` leaves out too; ``channels`` goes before the names above it. ``drop``, ``units``, ``signs``
and ``offsets`` name columns of the recording that comes out; ``*`` stands for any name
(``qvel/*: deg``). A unit is one of :data:`UNITS` or the factor to SI. What comes out is
sign · unit · value + offset, the offset in SI.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from wt.errors import DataError, suggest
from wt.types import Recording

Column = Float[np.ndarray, " time"]
Map = Mapping[str, Any]
"""The content of ``--map F.yaml``; what it may say stands here and at each importer."""

KEYS = frozenset(
    {"joints", "commands", "sensors", "channels", "units", "signs", "offsets", "drop", "meta"}
)
UNITS = {
    "SI": 1.0,
    "rad": 1.0,
    "deg": np.pi / 180.0,
    "rev": 2.0 * np.pi,
    "rpm": 2.0 * np.pi / 60.0,
    "m": 1.0,
    "mm": 1e-3,
}
"""Factor from each unit to SI; of a velocity, the unit of its position (``deg`` is deg/s)."""

_COLUMN = re.compile(r"(qpos|qvel|ctrl|force|sensor)/(.+?)(/\d+)?")
SECTION = {"qpos": "joints", "qvel": "joints", "ctrl": "commands", "force": "commands"}
"""The map's key for the names of a kind of column; ``sensors`` for every other."""


def apply(recording: Recording, mapping: Map) -> Recording:
    """The recording under the map's names, in SI units.

    Args:
        recording: what an importer read, under the source's names.
        mapping: the common keys of a map, see the module.

    Raises:
        DataError: the map names something that is not there, or a value is of the wrong kind.
    """
    columns = _without(_renamed(recording.columns, mapping), mapping)
    factors = {name: 1.0 for name in columns}
    offsets = {name: 0.0 for name in columns}
    for pattern, unit in _entries(mapping, "units").items():
        for name in matching(
            pattern, columns, "units", spread=not isinstance(mapping["units"], str)
        ):
            factors[name] = _factor(unit)
    for pattern, sign in _entries(mapping, "signs").items():
        if sign not in (1, -1):
            raise DataError(f"map signs: {pattern!r} is {sign!r}; a sign is 1 or -1")
        for name in matching(pattern, columns, "signs"):
            factors[name] *= sign
    for pattern, offset in _entries(mapping, "offsets").items():
        for name in matching(pattern, columns, "offsets"):
            offsets[name] = _number(offset, f"offsets: {pattern!r}")
    # SI value = sign · unit · raw + offset
    converted = {name: factors[name] * x + offsets[name] for name, x in columns.items()}
    meta = mapping.get("meta", {})
    if not isinstance(meta, Mapping):
        raise DataError(f"map meta holds {type(meta).__name__}; it must be 'key: value'")
    return Recording(recording.t, converted, {**recording.meta, **meta})


def matching(
    pattern: str, columns: Mapping[str, Column], key: str, spread: bool = True
) -> list[str]:
    """The columns that a pattern of the map names; ``*`` does not reach over a slash.

    Args:
        pattern: a column's name, ``*`` for any run of characters but a slash.
        columns: all columns.
        key: the map's key, for the message.
        spread: whether matching nothing is a mistake.

    Raises:
        DataError: it matches none.
    """
    expression = re.compile("[^/]*".join(re.escape(part) for part in pattern.split("*")))
    matches = [name for name in columns if expression.fullmatch(name)]
    if not matches and spread:
        raise DataError(f"map {key}: {pattern!r} is no column; {suggest(pattern, columns)}")
    return matches


def episode(path: Path, known: Sequence[int], wanted: object, else_: str = "") -> int:
    """The episode of a source that a map asks for, or its only one.

    Args:
        path: the source.
        known: its episodes, ascending.
        wanted: the map's ``episode``; None without.
        else_: what else can be done where there are several.

    Raises:
        DataError: there are several and none was asked for, or it is not among them.
    """
    if wanted is None and len(known) > 1:
        raise DataError(
            f"'{path}' holds {len(known)} episodes, {known[0]} to {known[-1]}; choose one in the "
            f"map with 'episode: N'{else_}"
        )
    chosen = known[0] if wanted is None else wanted
    if isinstance(chosen, bool) or chosen not in known:
        raise DataError(f"map episode: {chosen!r} is not there; there are {known[0]}…{known[-1]}")
    return cast(int, chosen)


def says(mapping: Map, key: str, *columns: str) -> bool:
    """True if the map settles ``key`` (units, signs) of one of these columns by itself."""
    entries = _entries(mapping, key)
    named = {c: np.empty(0) for c in columns}
    return any(matching(p, named, key, spread=False) for p in entries)


def _without(columns: dict[str, Column], mapping: Map) -> dict[str, Column]:
    """The columns that the map does not drop."""
    patterns = mapping.get("drop", [])
    if isinstance(patterns, str) or not isinstance(patterns, Sequence):
        raise DataError(f"map drop holds {patterns!r}; it must be a list of columns: [force/*, …]")
    dropped = {name for p in patterns for name in matching(str(p), columns, "drop")}
    return {name: values for name, values in columns.items() if name not in dropped}


def _entries(mapping: Map, key: str) -> dict[str, Any]:
    entries = mapping.get(key, {})
    if key == "units" and isinstance(entries, str):
        return {f"{kind}/*": entries for kind in ("qpos", "qvel", "ctrl")}
    if not isinstance(entries, Mapping):
        raise DataError(f"map {key} holds {entries!r}; it must be 'name: value' lines")
    return {str(name): value for name, value in entries.items()}


def _renamed(columns: Mapping[str, Column], mapping: Map) -> dict[str, Column]:
    return {new: columns[old] for old, new in renames(columns, mapping).items() if new is not None}


def renames(columns: Iterable[str], mapping: Map) -> dict[str, str | None]:
    """New name of each column of a source; None where it is left out.

    Raises:
        DataError: the map names something that is not there, or two columns would be one.
    """
    names = tuple(columns)
    made = _Renames(mapping, names)
    renamed: dict[str, str | None] = {}
    for column in names:
        key, new = made.of(column)
        if new is not None and new in renamed.values():
            raise DataError(f"map {key}: two columns would be '{new}'")
        renamed[column] = new
    made.refuse_unused()
    return renamed


class _Renames:
    """What a map makes of each column's name, and which of its entries were of use."""

    def __init__(self, mapping: Map, columns: Iterable[str]) -> None:
        self.channels = _entries(mapping, "channels")
        self.names = {key: _entries(mapping, key) for key in ("joints", "commands", "sensors")}
        self.used: set[tuple[str, str]] = set()
        self.there: dict[str, set[str]] = {key: set() for key in self.names}
        self.there["channels"] = set(columns)

    def of(self, column: str) -> tuple[str, str | None]:
        """The key of the map that names a column, and its new name; None leaves it out."""
        match = _COLUMN.fullmatch(column)
        own = column in self.channels
        if own:
            self.used.add(("channels", column))
        if match is None:
            return "channels", self._channel(column) if own else column
        kind, name, index = match[1], match[2], match[3] or ""
        key = SECTION.get(kind, "sensors")
        self.there[key].add(name)
        if key == "commands":
            self.there["joints"].add(name)
            # a command that the map does not name follows its joint
            key = key if name in self.names[key] else "joints"
        if name in self.names[key]:
            self.used.add((key, name))
        if own:
            return "channels", self._channel(column)
        new = self.names[key].get(name, name)
        return key, None if new is None else f"{kind}/{new}{index}"

    def _channel(self, column: str) -> str | None:
        new = self.channels[column]
        if new is not None and (not isinstance(new, str) or not _COLUMN.fullmatch(new)):
            raise DataError(
                f"map channels: {column!r} is to be {new!r}; give a column of a recording such as "
                "'qpos/<joint>' or 'ctrl/<actuator>', or null to leave it out"
            )
        return new

    def refuse_unused(self) -> None:
        """Refuse entries that name nothing of the source."""
        for key, entries in {**self.names, "channels": self.channels}.items():
            for name in entries:
                if (key, name) not in self.used:
                    raise DataError(
                        f"map {key}: {name!r} is not in the source; "
                        f"{suggest(name, self.there[key])}"
                    )


def _factor(unit: object) -> float:
    if isinstance(unit, str) and unit not in UNITS:
        raise DataError(f"map units: {unit!r} is not known: {suggest(unit, UNITS)} or a factor")
    return UNITS[unit] if isinstance(unit, str) else _number(unit, "units")


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DataError(f"map {where} is {value!r}; it must be a number")
    return float(value)


def refuse_unknown_keys(mapping: Map, allowed: set[str]) -> None:
    """Refuse keys of a map that the importer does not know.

    Raises:
        DataError: naming the key and the nearest allowed one.
    """
    for key in mapping:
        if key not in allowed:
            raise DataError(f"map key {key!r} is not known: {suggest(str(key), allowed)}")
