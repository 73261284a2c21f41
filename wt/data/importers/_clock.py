"""Several streams with clocks of their own, put onto the time stamps of one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

_GAP = 5.0  # median periods: a longer silence of a measured stream is a gap, not a slow sample


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


def held(commands: Stream, stamps: Int[np.ndarray, " stamp"]) -> Columns:
    """The command in force at each stamp: the last one sent until then; NaN before the first.

    Args:
        commands: what was sent when; a sample that lacks a command leaves it as it was.
        stamps: nanoseconds.
    """
    columns = {}
    for name, values in commands.columns.items():
        sent = np.isfinite(values)
        last = np.searchsorted(commands.stamps[sent], stamps, side="right") - 1
        columns[name] = np.where(last >= 0, values[sent][np.maximum(last, 0)], np.nan)
    return columns


def interpolated(measured: Stream, stamps: Int[np.ndarray, " stamp"]) -> Columns:
    """Measured quantities at other stamps, linear between samples; NaN outside and in gaps.

    Args:
        measured: what was measured when.
        stamps: nanoseconds.
    """
    columns = {}
    for name, values in measured.columns.items():
        known = np.isfinite(values)
        own = measured.stamps[known]
        column = np.full(len(stamps), np.nan)
        if len(own) > 1:
            after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
            wide = own[after] - own[after - 1] > _GAP * np.median(np.diff(own))
            inside = (stamps >= own[0]) & (stamps <= own[-1]) & ~(wide & ~np.isin(stamps, own))
            # relative to the first: nanoseconds since 1970 are more digits than a float has
            here, there = (stamps - own[0])[inside], own - own[0]
            column[inside] = np.interp(here, there, values[known])
        columns[name] = column
    return columns
