"""Reading of recordings that break the format in ways that can be mended: stamps that go wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wt.check.finding import AuditFinding
from wt.data import recording as recordings
from wt.errors import RecordingError
from wt.types import Recording


def read(path: str | Path) -> tuple[Recording, tuple[AuditFinding, ...]]:
    """A recording, with rows left out whose stamps repeat or go back, and what was found of them.

    Args:
        path: a Parquet file of the recording format.

    Raises:
        RecordingError: it cannot be read, or mended.
    """
    columns, meta = recordings.table(path)
    t = columns.pop("t")
    doubts: list[AuditFinding] = []
    if t.ndim == 1 and np.isfinite(t).all() and len(t) > 1:
        before = np.maximum.accumulate(t)
        keep = np.concatenate([[True], t[1:] > before[:-1]])
        if keep.sum() < 2:
            raise RecordingError(f"'{path}': column 't' never increases; give the samples' times")
        repeated = int((np.diff(t) == 0.0).sum())
        back = int((~keep).sum()) - repeated
        for count, kind, words in (
            (repeated, "stamps_repeated", "repeat the one before"),
            (back, "clock_backwards", "are earlier than one before"),
        ):
            if count > 0:
                row = int(np.flatnonzero(~keep)[0])
                doubts.append(
                    AuditFinding(
                        kind,
                        ("t",),
                        (),
                        f"{count} of {len(t)} time stamps {words}, the first in row {row} "
                        f"({t[row]:.6g} s)",
                        "leave these rows out, and log each sample once",
                    )
                )
        if doubts:
            t, columns = t[keep], {name: c[keep] for name, c in columns.items()}
    try:
        return Recording(t, columns, meta), tuple(doubts)
    except RecordingError as error:
        raise RecordingError(f"'{path}': {error}") from error
