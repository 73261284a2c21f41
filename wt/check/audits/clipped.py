"""Measurements, or a servo's commands, cut off at the end of a range, while the joint goes on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance
from wt.check.channels import DECISIVE, WRONG
from wt.check.finding import AuditFinding
from wt.check.signals import Signals, has, step_of
from wt.check.velocity import related
from wt.data.recording import coordinate
from wt.types import Recording

_LEAST = 0.01  # of all samples, at one end
_RUN = 5
_FAST = 0.3  # of the usual slope: what the other quantity says meanwhile
_BEYOND = 1.1  # of a velocity's end: what the position's slope is then
_TURNING = 2.0  # steps of an encoder, within which a motion may turn round
_MOST = 0.5  # of a command's samples, that may be cut off for the rest to say something
_PAST = 0.1  # of a position's deviation, that it goes beyond a command that was cut off
_ALIKE = 0.9  # correlation of both, apart from what is clipped
_OTHER = {"qpos": "qvel", "qvel": "qpos"}


@register
class Clipped:
    """A column that stays at exactly its largest value while the joint moves on."""

    kinds: ClassVar[tuple[str, ...]] = ("clipped",)
    stage: ClassVar[Stage] = "range"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each clipped column."""
        recording = subject.recording
        if recording is None:
            return
        for name in recording.columns:
            group, _, joint = name.partition("/")
            if group not in _OTHER or coordinate(joint) is not None:
                continue
            ends = _ends(recording.columns[name]) if has(recording.columns[name]) else []
            at = np.isin(recording.columns[name], ends)
            if not ends or not _moves(recording, joint, group, at):
                continue
            yield AuditFinding(
                "clipped",
                (name,),
                (f"joint {joint}",),
                f"{_held(recording, name, ends)}, while '{_OTHER[group]}/{joint}' says that it "
                "goes on",
                "widen the range of the sensor or of the log; clipped samples are missing ones",
                change=_Missing(name, ends),
            )
        balance = subject.balance
        if balance is not None and (balance.unexplained() > WRONG).any():
            yield from _commands(balance, recording)


def _commands(balance: Balance, recording: Recording) -> Iterable[AuditFinding]:
    """Commands of servos that were cut off by the log: their joints go further than they say.

    A stop, or a drive at its limit, holds a joint back instead.
    """
    for row, given in zip(balance.rows, balance.unexplained(), strict=True):
        drive, name, follows = row.drive, f"ctrl/{row.drive.name}", f"qpos/{row.drive.joint}"
        command, position = recording.columns[name], recording.columns[follows]
        ends = _ends(command) if drive.servo and given > WRONG else []
        if np.isin(command, ends).mean() > _MOST:
            continue
        told = drive.held_per_command * command
        beyond = np.zeros(0)
        for end in ends:
            past = np.sign(end - np.nanmedian(command)) * (position - told)[command == end]
            beyond = np.append(beyond, past)
        if not ends or not np.nanquantile(beyond, 0.9) > _PAST * np.nanstd(position):
            continue
        cut = _Without(name, ends)
        signals = Signals.of(balance.scene, cut(recording))
        if signals is None:
            continue
        other = Balance(balance.scene, signals)
        left = dict(zip((r.drive for r in other.rows), other.unexplained(), strict=True))
        if left.get(drive, np.inf) * DECISIVE > given:
            continue
        yield AuditFinding(
            "clipped",
            (name,),
            (f"actuator {drive.name}",),
            f"{_held(recording, name, ends)}, and '{follows}' goes on: apart from them the motion "
            f"explains {100.0 * (1.0 - left[drive]):.0f} % of it, and with them "
            f"{100.0 * max(0.0, 1.0 - given):.0f} %",
            "widen the range of the log; what was sent then is not known",
            0.9,
            change=cut,
        )


def _held(recording: Recording, name: str, ends: Sequence[float]) -> str:
    """The evidence that all clipped columns have: where they stay, and how long."""
    said = " and ".join(f"{end:.4g}" for end in ends)
    samples = int(np.isin(recording.columns[name], ends).sum())
    return f"'{name}' stays at exactly {said} for {samples} samples"


def _ends(column: Float[np.ndarray, " sample"]) -> list[float]:
    """Extreme values that are held."""
    held = []
    for end in (np.nanmax(column), np.nanmin(column)):
        at = column == end
        if at.mean() < _LEAST:
            continue
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]))))[::2]
        # of samples, not of runs: where noise crosses the end many runs are short
        if np.median(np.repeat(runs, runs)) >= _RUN:
            held.append(float(end))
    return held


def _moves(recording: Recording, joint: str, group: str, at: Bool[np.ndarray, " sample"]) -> bool:
    """Tell whether the joint's other column says that it goes on."""
    name = f"{group}/{joint}"
    free = _Missing(name, recording.columns[name][at])(recording)
    relation = related(free, joint, joint)
    if relation is None or abs(relation.correlation) < _ALIKE:
        return False
    if group == "qpos":
        v = recording.columns[f"qvel/{joint}"]
        if not np.isfinite(v[at]).any():
            return False
        travel = _travel(v / relation.factor, recording.t, at)
        return bool(
            np.nanmean(np.abs(v[at])) > _FAST * np.nanstd(v)
            and travel > _TURNING * step_of(recording.columns[name])
        )
    slope = relation.factor * np.gradient(recording.columns[f"qpos/{joint}"], recording.t)
    end = np.maximum(np.abs(recording.columns[name]), _FAST * np.nanstd(slope))
    past = np.abs(slope[at]) / end[at]
    return bool(np.isfinite(past).any() and np.nanmedian(past) > _BEYOND)


def _travel(
    v: Float[np.ndarray, " sample"],
    t: Float[np.ndarray, " sample"],
    at: Bool[np.ndarray, " sample"],
) -> float:
    """How far a velocity goes within the longest-going stretch of some samples [rad or m]."""
    way = np.cumsum(np.nan_to_num(v) * np.gradient(t))
    runs = np.split(way, np.flatnonzero(np.diff(at.astype(int))) + 1)
    return max(float(np.ptp(run)) for run in runs[0 if at[0] else 1 :: 2])


@dataclass(frozen=True, eq=False)
class _Without:
    """Leaves out the samples at which a column has some values."""

    name: str
    values: Sequence[float]

    def __call__(self, recording: Recording) -> Recording:
        keep = ~np.isin(recording.columns[self.name], self.values)
        columns = {n: c[keep] for n, c in recording.columns.items()}
        return replace(recording, t=recording.t[keep], columns=columns)


@dataclass(frozen=True, eq=False)
class _Missing:
    """Takes values out of a column."""

    name: str
    values: Sequence[float] | Float[np.ndarray, " sample"]

    def __call__(self, recording: Recording) -> Recording:
        column = recording.columns[self.name]
        cut = np.where(np.isin(column, self.values), np.nan, column)
        return replace(recording, columns={**recording.columns, self.name: cut})
