"""Several streams with clocks of their own, put onto the time stamps of one.

Map (optional), in every format whose quantities come at times of their own::

    join:                                         # column as the source names it: how
      "qpos/*": linear                            # between two samples
      "sensor/*/*": {how: nearest, tolerance: 0.01} # [s]
      "ctrl/*": {how: held, tolerance: 0.1}       # the last one until then

Left out, commands are held and everything else is linear, and a silence of five median periods is
a gap. With a tolerance, a value that is further away than it is missing; for ``linear`` it is the
longest silence that is bridged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from wt.data.importers._mapping import matching, refuse_unknown_keys
from wt.errors import DataError, suggest

_GAP = 5.0  # median periods: a longer silence of a measured stream is a gap, not a slow sample
_SECOND = 1e9  # ns
_Way = tuple[str, float | None]
_DEFAULT: dict[bool, _Way] = {True: ("held", None), False: ("linear", None)}
"""How commands, and what is measured, are joined where the map does not say."""


Columns = dict[str, Float64[np.ndarray, " stamp"]]


@dataclass(frozen=True)
class Stream:
    """Quantities that came together.

    Attributes:
        stamps: when, nanoseconds, strictly increasing.
        columns: the quantities by recording column; NaN where one was not in a sample.
    """

    stamps: Int[np.ndarray, " sample"]
    columns: Mapping[str, Float64[np.ndarray, " sample"]]


def stream(stamps: Iterable[int], rows: Iterable[Mapping[str, float]]) -> Stream:
    """A stream from one mapping a sample, in time's order; of equal stamps the last counts.

    Args:
        stamps: nanoseconds, in any order.
        rows: quantities of each sample by recording column.
    """
    by_time = dict(sorted(zip(stamps, rows, strict=True), key=lambda pair: pair[0]))
    names = dict.fromkeys(name for row in by_time.values() for name in row)
    nan = float("nan")
    columns = {n: np.array([row.get(n, nan) for row in by_time.values()]) for n in names}
    return Stream(np.array(list(by_time), dtype=np.int64), columns)


def joined(
    sources: Sequence[Stream], stamps: Int[np.ndarray, " stamp"], wanted: object = None
) -> Columns:
    """Streams' quantities at other stamps, each in the map's way or in its own.

    Args:
        sources: what came when; of two with a column of the same name, the last counts.
        stamps: nanoseconds.
        wanted: the map's ``join``; see the module.

    Raises:
        DataError: ``join`` is none, or names a column that is in no stream.
    """
    ways = {name: _DEFAULT[name.startswith("ctrl/")] for s in sources for name in s.columns}
    for pattern, way in _ways(wanted).items():
        every = {name: values for s in sources for name, values in s.columns.items()}
        ways |= dict.fromkeys(matching(pattern, every, "join"), way)
    columns: Columns = {}
    for source in sources:
        for name, values in source.columns.items():
            known = np.isfinite(values)
            how, tolerance = ways[name]
            columns[name] = _HOW[how](source.stamps[known], values[known], stamps, tolerance)
    return columns


def _ways(wanted: object) -> dict[str, _Way]:
    if wanted is None:
        return {}
    if not isinstance(wanted, Mapping):
        raise DataError("map join must be '<column>: linear, nearest or held' lines")
    ways: dict[str, _Way] = {}
    for name, entry in wanted.items():
        way = entry if isinstance(entry, Mapping) else {"how": entry}
        refuse_unknown_keys(way, {"how", "tolerance"})
        how, tolerance = way.get("how"), way.get("tolerance")
        if not isinstance(how, str) or how not in _HOW:
            raise DataError(f"map join: {name!r} is {how!r}: {suggest(str(how), _HOW)}")
        number = isinstance(tolerance, int | float) and not isinstance(tolerance, bool)
        if tolerance is not None and not (number and tolerance > 0):
            raise DataError(f"map join: tolerance of {name!r} is {tolerance!r}; it is in s, over 0")
        ways[str(name)] = (how, None if tolerance is None else float(tolerance))
    return ways


_Stamps = Int[np.ndarray, " _"]
_Values = Float64[np.ndarray, " _"]


def _held(own: _Stamps, values: _Values, stamps: _Stamps, tolerance: float | None) -> _Values:
    """The last value until then; NaN before the first."""
    if len(own) == 0:
        return np.full(len(stamps), np.nan)
    last = np.searchsorted(own, stamps, side="right") - 1
    valid = last >= 0
    if tolerance is not None:
        valid &= stamps - own[np.maximum(last, 0)] <= tolerance * _SECOND
    return np.where(valid, values[np.maximum(last, 0)], np.nan)


def _nearest(own: _Stamps, values: _Values, stamps: _Stamps, tolerance: float | None) -> _Values:
    """The value that came next to it in time; without a tolerance, within the usual gap."""
    if len(own) < 2:
        return np.full(len(stamps), np.nan)
    after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
    near = after - ((stamps - own[after - 1]) <= (own[after] - stamps))
    widest = _GAP * np.median(np.diff(own)) if tolerance is None else tolerance * _SECOND
    return np.where(np.abs(own[near] - stamps) <= widest, values[near], np.nan)


def _linear(own: _Stamps, values: _Values, stamps: _Stamps, tolerance: float | None) -> _Values:
    """Between two samples; NaN outside and in gaps."""
    column = np.full(len(stamps), np.nan)
    if len(own) > 1:
        after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
        widest = _GAP * np.median(np.diff(own)) if tolerance is None else tolerance * _SECOND
        wide = own[after] - own[after - 1] > widest
        inside = (stamps >= own[0]) & (stamps <= own[-1]) & ~(wide & ~np.isin(stamps, own))
        # relative to the first: nanoseconds since 1970 are more digits than a float has
        column[inside] = np.interp((stamps - own[0])[inside], own - own[0], values)
    return column


_How = Callable[[_Stamps, _Values, _Stamps, float | None], _Values]
_HOW: dict[str, _How] = {"linear": _linear, "nearest": _nearest, "held": _held}
