"""Recordings that hold the same motion, though not the same bytes: copies, parts, other encodings.

Two runs of one motion differ by the noise of their sensors, and by more. What agrees far better
than that was recorded once: it proves nothing of a fit to itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from jaxtyping import Float

from wt.errors import RecordingError
from wt.types import Recording

_FEWEST = 50
"""Samples that tell."""
_SAME_RATE = 0.02
"""Share by which the intervals of two recordings differ at most: else no sample meets another."""
_THERE = 0.5
"""Share of its samples that a column has to have."""
_ORDERS = (2, 4, 6)
_BELOW_NOISE, _ROUNDED = 0.3, 1e-6
"""Difference of copies, in the noise of one, or as a share of its spread where it has none."""


def refuse_repeated(named: Sequence[tuple[str, Recording]], held_out: int) -> None:
    """Refuse a recording that holds what another one holds.

    Args:
        named: names and recordings.
        held_out: index of the first that is for the proof only.

    Raises:
        RecordingError: one of them is another one, or a part of it.
    """
    for j, (name, recording) in enumerate(named):
        for i, (earlier, known) in enumerate(named[:j]):
            start = repeated(known, recording)
            if start is None:
                continue
            said = f"'{name}' holds the motion of '{earlier}'"
            said += f" from {start:.3g} s on" if start > 0.0 else ""
            if (i < held_out) == (j < held_out):
                raise RecordingError(
                    f"{said}: what is told twice is no more likely; name one of them"
                )
            raise RecordingError(
                f"{said}, one to be fitted and one held out: what was fitted proves nothing; give "
                "another recording of the same machine, or leave --holdout out"
            )


def repeated(one: Recording, other: Recording) -> float | None:
    """When the shorter of two recordings begins in the longer one [s]; None if it is not in it."""
    longer, shorter = sorted((one, other), key=len, reverse=True)
    names = sorted(_positions(longer) & _positions(shorter))
    if not names or len(shorter) < _FEWEST or not _as_fast(longer, shorter):
        return None
    a, b = (np.stack([r.columns[n] for n in names], axis=1) for r in (longer, shorter))
    moving = np.nanstd(b, axis=0) > 0.0
    if not moving.any():
        return None
    a, b = a[:, moving], b[:, moving]
    limit = np.maximum(_BELOW_NOISE * _noise(b), _ROUNDED * np.nanstd(b, axis=0))
    whole = np.flatnonzero(np.isfinite(b).all(axis=1))
    first = int(whole[0]) if len(whole) else len(b)
    if len(b) - first < _FEWEST:
        return None
    last = len(a) - len(b) + 1
    begins = np.flatnonzero((np.abs(a[first:][:last] - b[first]) <= 10.0 * limit).all(axis=1))
    for k in begins:
        # at rest many samples look like the first
        if all(_alike(a[k:], b, slice(first, end), limit) for end in (first + _FEWEST, len(b))):
            return float(longer.t[k] - longer.t[0])
    return None


def _positions(recording: Recording) -> set[str]:
    """Columns of positions that are there most of the time."""
    return {
        name
        for name, column in recording.columns.items()
        if name.startswith("qpos/") and np.isfinite(column).mean() > _THERE
    }


def _as_fast(one: Recording, other: Recording) -> bool:
    intervals = [float(np.median(np.diff(r.t))) for r in (one, other)]
    return abs(intervals[0] - intervals[1]) <= _SAME_RATE * max(intervals)


def _alike(
    one: Float[np.ndarray, "_ joint"],
    other: Float[np.ndarray, "sample joint"],
    rows: slice,
    limit: Float[np.ndarray, " joint"],
) -> bool:
    """Whether two motions differ by no more than a limit, where both are known."""
    apart = one[rows] - other[rows]
    known = np.isfinite(apart)
    square = np.where(known, apart, 0.0) ** 2
    return bool((square.sum(axis=0) <= known.sum(axis=0) * limit**2).all())


def _noise(q: Float[np.ndarray, "sample joint"]) -> Float[np.ndarray, " joint"]:
    """Deviation of what is not smooth from sample to sample, by differences of rising order.

    Those of low order have some of the motion in them, the more the slower a log is.
    """
    each = [
        np.nanmedian(np.abs(np.diff(q, n=n, axis=0)), axis=0) / np.sqrt(comb(2 * n, n))
        for n in _ORDERS
    ]
    return np.asarray(1.4826 * np.min(each, axis=0))
