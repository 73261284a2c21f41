"""Columns that stand still while what they measure moves, or are empty, and repeated samples."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding, Change, leave_out
from wt.data.recording import coordinate
from wt.physics.scene import Drive
from wt.types import Recording

_SWEPT = 0.3  # rad or m that a command sweeps while its joint's column stands still
_LONG_S = 1.0
_PUSHED = 3.0  # times all that a motion takes: no load is so large
_LEAP = 2.0  # times the largest of a command's other steps
_LEAPT = 0.05  # rad or m
_RESTING = 0.2  # of a command's samples, that may repeat the one before
_TRAVEL = 0.2  # rad or m that a velocity integrates to
_REPEATED, _QUANTA = 0.3, 4.0
_PAUSE, _HELD = 12, 0.4  # samples between leaps of one motion; share of them that repeat


@register
class Frozen:
    """A column that never changes, stops changing, or changes at every few samples only."""

    kinds: ClassVar[tuple[str, ...]] = ("frozen", "samples_repeated", "empty")
    stage: ClassVar[Stage] = "column"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each frozen column, and one for repeated samples."""
        recording = subject.recording
        if recording is None:
            return
        for name, column in recording.columns.items():
            if not np.isfinite(column).any():
                yield _empty(name)
                continue
            if coordinate(name) is not None:
                continue
            if name.startswith("qpos/"):
                yield from _position(subject, recording, name)
            elif name.startswith("qvel/"):
                yield from _velocity(recording, name)
        for drive in subject.scene.drives if subject.scene else ():
            if drive.servo:
                yield from _command(recording, drive)
                yield from _never(subject, recording, drive)
        yield from _repeats(recording)


def _empty(name: str) -> AuditFinding:
    return AuditFinding(
        "empty",
        (name,),
        (),
        f"'{name}' has no value at all",
        f"leave '{name}' out, or log it",
        change=leave_out(name),
    )


def _position(subject: Subject, recording: Recording, name: str) -> Iterable[AuditFinding]:
    joint = name.removeprefix("qpos/")
    start, end = _longest(recording.columns[name])
    t = recording.t
    if end - start < 12 or t[end] - t[start] < _LONG_S:
        return
    evidence = ""
    velocity = recording.columns.get(f"qvel/{joint}")
    if velocity is not None:
        run = np.nan_to_num(velocity[start : end + 1])
        travel = float(np.ptp(np.cumsum(run[:-1] * np.diff(t[start : end + 1]))))
        if travel > _TRAVEL and np.std(run) > 0.0:
            evidence = f"'qvel/{joint}' integrates to {travel:.3g} meanwhile"
    leap = _leap(recording.columns[name], start, end)
    if leap > _LEAPT:
        evidence = f"then leaps by {leap:.3g}"
    for drive in subject.scene.drives if subject.scene else ():
        command = recording.columns.get(f"ctrl/{drive.name}")
        throughout = end - start > 0.98 * len(t)
        if drive.joint == joint and command is not None and throughout:
            swept = _commanded(drive, t[start : end + 1], command[start : end + 1])
            if swept > _SWEPT:
                evidence = f"its command sweeps {swept:.3g} meanwhile"
    if evidence:
        yield AuditFinding(
            "frozen",
            (name,),
            (f"joint {joint}",),
            f"'{name}' does not change for {t[end] - t[start]:.3g} s from "
            f"{t[start] - t[0]:.4g} s on, and {evidence}",
            f"record '{joint}' again, or leave that time out",
            change=_missing(name, start, end),
        )


def _commanded(
    drive: Drive, t: Float[np.ndarray, " sample"], command: Float[np.ndarray, " sample"]
) -> float:
    """How far a command sends a joint that follows it, in position or in speed [rad or m]."""
    if drive.servo:
        return float(np.ptp(command))
    if drive.bias[2] == 0.0:
        return 0.0
    speed = np.nan_to_num(command) * drive.gain / abs(drive.bias[2] * drive.gear)
    return float(np.ptp(np.cumsum(speed[:-1] * np.diff(t))))


def _velocity(recording: Recording, name: str) -> Iterable[AuditFinding]:
    """A velocity that is constant although the position moves."""
    position = recording.columns.get(name.replace("qvel/", "qpos/"))
    velocity = recording.columns[name]
    if position is None or not np.isfinite(position).any() or not np.isfinite(velocity).any():
        return
    if np.nanmax(velocity) > np.nanmin(velocity):  # a deviation of equal numbers may round to > 0
        return
    travel = float(np.nanmax(position) - np.nanmin(position))
    if travel < _TRAVEL:
        return
    yield AuditFinding(
        "frozen",
        (name,),
        (),
        f"'{name}' never changes, and its position moves by {travel:.3g}",
        f"leave '{name}' out",
        change=leave_out(name),
    )


def _command(recording: Recording, drive: Drive) -> Iterable[AuditFinding]:
    """A servo's command that stops while its joint goes on, and then leaps to where it is.

    Without that leap it may be a command that was held, and another load that moved the joint.
    """
    name, t = f"ctrl/{drive.name}", recording.t
    command, position = recording.columns.get(name), recording.columns.get(f"qpos/{drive.joint}")
    if command is None or position is None:
        return
    start, end = _longest(command)
    if end - start < 12 or t[end] - t[start] < _LONG_S:
        return
    swept = float(np.ptp(np.nan_to_num(position[start : end + 1], nan=position[start])))
    leap = _leap(command, start, end)
    if not leap or not swept > _SWEPT:
        return
    yield AuditFinding(
        "frozen",
        (name,),
        (f"actuator {drive.name}",),
        f"'{name}' does not change for {t[end] - t[start]:.3g} s from {t[start] - t[0]:.4g} s on, "
        f"its joint moves by {swept:.3g} meanwhile, and then the command leaps by {leap:.3g}",
        f"record '{name}' again, or leave that time out",
        change=_cut(float(t[start]), float(t[end])),
    )


def _leap(column: Float[np.ndarray, " sample"], start: int, end: int) -> float:
    """How far a column leaps after a stretch of standing still; 0 if it goes on from there."""
    if end + 1 >= len(column):
        return 0.0
    step = np.abs(np.diff(column))
    others = np.delete(step, slice(start, end + 1))
    moves = np.isfinite(others).all() and np.mean(others == 0.0) <= _RESTING
    return float(step[end]) if moves and step[end] >= _LEAP * others.max() else 0.0


def _never(subject: Subject, recording: Recording, drive: Drive) -> Iterable[AuditFinding]:
    """A servo's command that never changes, while its joint goes where that servo would not let it.

    It would push back by more than the motion takes: the command was not logged, or the drive off.
    """
    name, s = f"ctrl/{drive.name}", subject.signals
    command = recording.columns.get(name)
    if command is None or s is None or subject.balance is None or not subject.balance.dynamic:
        return
    known = command[np.isfinite(command)]
    if not len(known) or np.ptp(known) > 0.0 or not s.measured[drive.dof]:
        return
    swept = float(np.ptp(s.q[:, drive.dof]))
    stiffness = abs(drive.bias[1]) * drive.gear**2
    takes = float(np.ptp(subject.balance.inverse(s.q, s.v, s.a)[:, drive.dof]))
    if swept < _SWEPT or stiffness * swept < _PUSHED * takes:
        return
    yield AuditFinding(
        "frozen",
        (name,),
        (f"actuator {drive.name}",),
        f"'{name}' never changes, and its joint moves by {swept:.3g}: held there its servo would "
        f"change its force by {stiffness * swept:.3g}, and that motion takes {takes:.3g}",
        f"log what was sent to '{drive.name}', or leave it out of the model if it was off",
        0.9,
    )


def _cut(start: float, end: float) -> Change:
    """Leaves out what comes after one time [s] and until another: nobody knows its commands."""

    def change(recording: Recording) -> Recording:
        keep = (recording.t <= start) | (recording.t > end)
        columns = {n: c[keep] for n, c in recording.columns.items()}
        return replace(recording, t=recording.t[keep], columns=columns)

    return change


def _longest(column: Float[np.ndarray, " sample"]) -> tuple[int, int]:
    """First and last sample of the longest stretch in which a column does not change."""
    same = np.concatenate([[False], np.diff(column) == 0.0, [False]])
    edges = np.flatnonzero(np.diff(same.astype(int)))
    if not len(edges):
        return 0, 0
    starts, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - starts))
    return int(starts[k]), int(ends[k])


def _missing(name: str, start: int, end: int) -> Change:
    def change(recording: Recording) -> Recording:
        column = recording.columns[name].copy()
        column[start + 1 : end + 1] = np.nan
        kept = dict(recording.columns)
        if np.isfinite(column).sum() < 12:
            kept.pop(name)
            kept.pop(name.replace("qpos/", "qvel/"), None)
        else:
            kept[name] = column
        return replace(recording, columns=kept)

    return change


def _repeats(recording: Recording) -> Iterable[AuditFinding]:
    """Samples that hold what the one before held: the log runs faster than the sensors, or one."""
    measured = [
        name
        for name, column in recording.columns.items()
        if name.startswith(("qpos/", "qvel/")) and np.isfinite(column).any()
    ]
    whole = _repeated(recording, measured)
    if whole:
        yield whole
        return
    channels: dict[str, list[str]] = {}
    for name in measured:
        if coordinate(name) is None:
            channels.setdefault(name.partition("/")[2], []).append(name)
    found = [_repeated(recording, names) for names in channels.values()]
    yield from (finding for finding in found if finding)


def _repeated(recording: Recording, measured: list[str]) -> AuditFinding | None:
    """Columns that all change at every few samples only, though what they measure moves."""
    if not measured:
        return None
    table = np.stack([recording.columns[n] for n in measured], axis=1)
    table = table[:, np.nanmax(table, axis=0) > np.nanmin(table, axis=0)]
    if not table.size:
        return None
    change = np.abs(np.diff(table, axis=0))
    known = np.isfinite(change).all(axis=1)
    same = known & (change == 0.0).all(axis=1)
    moved = change[known & ~same]
    if len(moved) < 20 or same[known].mean() < _REPEATED:
        return None
    # the smallest change that a column ever makes: an encoder's step, if it has one
    quantum = np.array([c[c > 0.0].min() if (c > 0.0).any() else np.inf for c in moved.T])
    leaps = np.flatnonzero(known & ((change / quantum).max(axis=1) >= _QUANTA))
    apart = np.diff(leaps)
    # from one leap to the next nothing happens, though what leaps so far cannot have stopped
    idle = np.array([bool(same[i + 1 : j].all()) for i, j in itertools.pairwise(leaps)], bool)
    moving = apart <= _PAUSE
    if moving.sum() < 20 or np.mean(idle[moving] & (apart[moving] > 1)) < _HELD:
        return None
    period = float(apart[moving].mean())
    return AuditFinding(
        "samples_repeated",
        tuple(measured),
        (),
        f"{100 * same[known].mean():.0f} % of the samples of '{measured[0]}' repeat the one "
        f"before, also while what they measure moves: new ones come every {period:.1f} samples",
        "log at the sensors' own rate, or mark repeated samples as missing",
        change=_unrepeated(measured),
    )


def _unrepeated(names: list[str]) -> Change:
    def change(recording: Recording) -> Recording:
        table = np.stack([recording.columns[n] for n in names], axis=1)
        same = np.concatenate([[False], (np.diff(table, axis=0) == 0.0).all(axis=1)])
        return replace(
            recording,
            columns={
                **recording.columns,
                **{n: np.where(same, np.nan, recording.columns[n]) for n in names},
            },
        )

    return change
