"""A process that keeps what the runner records, so that the runner may be killed at any time.

It appends every tick to a journal on the disk. If the pipe closes before the runner has written its
own files, the scribe makes them of the journal: the recording up to the last tick. A runner that
has written them dismisses it. Where runner and scribe are killed both, or the power is cut, the
journal stays, and :func:`recover` makes the files later.

The journal is what the pipe carries: a line of JSON, then rows of float64. Unlike a Parquet file,
which is nothing without its end, it may end anywhere.
"""

from __future__ import annotations

import fcntl
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from deploy import follower
from deploy.follower import Follower
from deploy.record import Recorder
from wt.errors import DataError, WorkError

JOURNAL = "journal.ticks"
_SYNCED_S = 1.0
"""Power that is cut takes at most so much of a run [s]."""


def scribe(folder: Path, recorder: Recorder, meta: Mapping[str, object]) -> Follower:
    """Start the process.

    Args:
        folder: where it writes.
        recorder: whose rows it keeps.
        meta: free metadata of both files.
    """
    return Follower("deploy.scribe", [str(folder)], recorder, meta)


def discard(folder: Path) -> None:
    """Remove the journal of a run whose files are written."""
    (folder / JOURNAL).unlink(missing_ok=True)


def recover(folder: Path) -> list[Path]:
    """Make the files of a run that neither its runner nor its scribe lived to write.

    Args:
        folder: of the run.

    Returns:
        What was written, as :meth:`deploy.record.Recorder.write` says.

    Raises:
        DataError: it has no journal, or one that ends before the first tick.
        WorkError: the run still goes on.
    """
    try:
        with (folder / JOURNAL).open("rb") as journal:
            _claim(journal, folder)
            return _write(folder)
    except FileNotFoundError as error:
        raise DataError(
            f"{folder} has no {JOURNAL}: there is nothing to recover, its files are written"
        ) from error


def main(folder: Path) -> None:
    """Keep what comes until the pipe closes, then write.

    Args:
        folder: where to.
    """
    stream = follower.told()
    if not (header := stream.readline()):
        return
    with (folder / JOURNAL).open("wb", buffering=0) as journal:
        _claim(journal, folder)
        journal.write(header)
        synced = time.monotonic()
        while content := stream.read1():
            journal.write(content)
            if time.monotonic() - synced > _SYNCED_S:
                os.fsync(journal)
                synced = time.monotonic()
        _write(folder)


def _claim(journal: BinaryIO, folder: Path) -> None:
    try:
        fcntl.flock(journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise WorkError(f"{folder} is of a run that goes on; end it first") from error


def _write(folder: Path) -> list[Path]:
    """Make the files of the journal, and remove it."""
    with (folder / JOURNAL).open("rb") as journal:
        try:
            header = follower.header(journal)
            width = len(header["columns"]["log"])
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(
                f"{folder / JOURNAL} ends before the first tick, or is no journal of wt-run; "
                "delete it"
            ) from error
        kept = [np.empty((0, width)), *follower.rows(journal, width)]
    recorder = Recorder.restored(header["columns"], np.concatenate(kept))
    written = recorder.write(folder, {**header["meta"], "killed": True})
    discard(folder)
    return written


if __name__ == "__main__":
    main(Path(sys.argv[1]))
