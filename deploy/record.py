"""Records of a run: a recording that ``wt diagnose`` reads, and a log of every tick.

``recording.parquet`` has the states during which the drives held positions with the policy's gains,
on the robot's clock: what a simulator of the robot can be compared with. ``log.parquet`` has every
tick on the runner's clock, with columns beyond the recording format: stage, command, action, …
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from deploy.robot import Command, State
from wt.data.recording import META_KEY, write
from wt.errors import RecordingError
from wt.types import Recording

RECORDING, LOG = "recording.parquet", "log.parquet"
_BLOCK = 8192  # rows that are made room for at a time


class Table:
    """Rows of numbers, appended in microseconds."""

    def __init__(self, columns: Sequence[str]) -> None:
        """An empty table; the first column is ``t``."""
        self.columns = tuple(columns)
        self._blocks: list[np.ndarray] = []
        self._used = _BLOCK

    def append(self, *parts: np.ndarray | float) -> None:
        """A row, in pieces."""
        if self._used == _BLOCK:
            self._blocks.append(np.empty((_BLOCK, len(self.columns))))
            self._used = 0
        row, at = self._blocks[-1][self._used], 0
        for part in parts:
            size = part.size if isinstance(part, np.ndarray) else 1
            row[at : at + size] = part
            at += size
        self._used += 1

    def extend(self, rows: np.ndarray) -> None:
        """Many rows, (N, columns)."""
        for row in rows:
            self.append(row)

    def last(self) -> np.ndarray:
        """The row that was appended last, (columns,)."""
        return self._blocks[-1][self._used - 1]

    def __len__(self) -> int:
        """Number of rows."""
        return max(0, len(self._blocks) - 1) * _BLOCK + (self._used if self._blocks else 0)

    def rows(self) -> np.ndarray:
        """All rows, (N, columns)."""
        if not len(self):
            return np.empty((0, len(self.columns)))
        return np.concatenate([*self._blocks[:-1], self._blocks[-1][: self._used]])

    def recording(self, meta: dict[str, object]) -> Recording:
        """As a recording that begins at 0 s; rows whose time does not increase are left out.

        Raises:
            RecordingError: it is too short for one.
        """
        rows = self.rows()
        if not len(rows):
            raise RecordingError("nothing was recorded")
        t = rows[:, 0] - rows[0, 0]
        increases = t > np.concatenate([[-1.0], np.maximum.accumulate(t)[:-1]])
        values = dict(zip(self.columns[1:], rows[increases, 1:].T, strict=True))
        return Recording(t[increases], values, meta)


class Recorder:
    """Both tables of a run."""

    def __init__(
        self, measured: Sequence[str], joints: Sequence[str], extra: Sequence[str]
    ) -> None:
        """Make room.

        Args:
            measured: columns of what is measured.
            joints: of the robot; its actuators have the same names.
            extra: columns that only the log has.
        """
        self._no_target, self._unknown = (
            np.full(len(joints), np.nan),
            np.full(len(measured), np.nan),
        )
        names = (*(f"ctrl/{joint}" for joint in joints), *measured)
        self._recording = Table(["t", *names])
        self._log = Table(["t", *names, "robot_time", *extra])
        self._followers: list[Callable[[np.ndarray], None]] = []

    @property
    def columns(self) -> dict[str, list[str]]:
        """Names of the columns of both tables: what :meth:`restored` needs beside the rows."""
        return {"recording": list(self._recording.columns), "log": list(self._log.columns)}

    def follow(self, follower: Callable[[np.ndarray], None]) -> None:
        """Have somebody told every row of the log, in the loop: it must not wait."""
        self._followers.append(follower)

    @classmethod
    def restored(cls, columns: Mapping[str, Sequence[str]], rows: np.ndarray) -> Recorder:
        """A recorder with the rows of a log; the recording follows from them.

        Args:
            columns: :attr:`columns` of the one that noted them.
            rows: of its log, (N, columns of the log).
        """
        made = cls((), (), ())
        made._recording, made._log = (Table(columns[k]) for k in ("recording", "log"))
        made._log.extend(rows)
        known = len(columns["recording"])  # t, targets and measurements, in both tables
        recorded = np.column_stack([rows[:, known], rows[:, 1:known]])
        # told positions, and heard of
        known_rows = np.isfinite(rows[:, 1]) & np.isfinite(rows[:, known])
        made._recording.extend(recorded[known_rows])
        return made

    def row(
        self, now: float, robot_time: float | None, measured: np.ndarray, command: Command,
        extra: Sequence[float],
    ) -> None:  # fmt: skip
        """Note one tick.

        Args:
            now: when, by the log's clock [s].
            robot_time: when by the robot's, if it was heard in this tick.
            measured: what it said then.
            command: what it was told.
            extra: values of the log's own columns.
        """
        target = command.target if command.stiffness.any() else self._no_target
        if robot_time is None:
            robot_time, measured = np.nan, self._unknown
        elif target is not self._no_target:
            self._recording.append(robot_time, target, measured)
        self._log.append(now, target, measured, robot_time, *extra)
        for follower in self._followers:
            follower(self._log.last())

    @property
    def recorded_s(self) -> float:
        """Time that the recording spans [s]."""
        return float(np.ptp(self._recording.rows()[:, 0])) if len(self._recording) else 0.0

    def recording(self) -> Recording:
        """What was recorded so far, from 0 s.

        Raises:
            RecordingError: it is too short for one.
        """
        return self._recording.recording({})

    def ticks(self) -> dict[str, np.ndarray]:
        """The log's columns by name."""
        return dict(zip(self._log.columns, self._log.rows().T, strict=True))

    def write(self, folder: Path, meta: dict[str, object]) -> list[Path]:
        """Write what there is, each file whole or not at all.

        Args:
            folder: where to; it is made.
            meta: free metadata of both.

        Returns:
            What was written: less than two seconds of motion is no recording and is left out.
        """
        if not len(self._log):
            return []
        written = [folder / LOG]
        folder.mkdir(parents=True, exist_ok=True)
        _write_whole(folder / LOG, self.ticks(), meta)
        with suppress(RecordingError):
            write(self._recording.recording(meta), folder / RECORDING)
            written.insert(0, folder / RECORDING)
        return written


def _write_whole(path: Path, columns: Mapping[str, np.ndarray], meta: dict[str, object]) -> None:
    """A table of any length as Parquet; an earlier file stays until this one is whole."""
    about = {META_KEY: json.dumps(meta).encode()}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        pq.write_table(pa.table(dict(columns)).replace_schema_metadata(about), temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def state_columns(joints: Sequence[str]) -> list[str]:
    """Columns of :func:`state_values`, in order."""
    names = [f"{kind}/{joint}" for kind in ("qpos", "qvel", "force") for joint in joints]
    names += [f"sensor/gyro/{k}" for k in range(3)]
    return names + [f"sensor/orientation/{k}" for k in range(4)]


def state_values(state: State) -> np.ndarray:
    """A state as one row."""
    parts = (state.position, state.velocity, state.torque, state.gyro, state.quaternion)
    return np.concatenate(parts)
