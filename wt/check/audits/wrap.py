"""Encoders that wrap around, at ±π or at a whole turn."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.data.recording import coordinate
from wt.types import Recording

_TURNS = {2.0 * math.pi: "rad", 360.0: "degrees", 1.0: "turns", 4096.0: "ticks"}
_JUMP = 0.25  # of a turn, by which a jump may miss it
_ENDS = 0.3  # of a turn: how near to the ends of the range a wrap happens
_ON = 2.0  # times the largest of the other steps, that the way on across a wrap may be


@register
class Wrap:
    """A position that jumps by a whole turn from one end of a turn to the other."""

    kinds: ClassVar[tuple[str, ...]] = ("encoder_wrap", "command_wrap")
    stage: ClassVar[Stage] = "column"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each column that wraps."""
        recording = subject.recording
        for name, column in (recording.columns if recording else {}).items():
            group, _, channel = name.partition("/")
            if group not in ("qpos", "ctrl") or coordinate(channel) is not None:
                continue
            turn = _turn(column)
            if turn is None:
                continue
            assert recording is not None
            count = int((np.abs(np.diff(column[np.isfinite(column)])) > (1 - _JUMP) * turn).sum())
            middle = _counterpart(subject, recording, group, channel)
            yield AuditFinding(
                "encoder_wrap" if group == "qpos" else "command_wrap",
                (name,),
                (f"joint {channel}" if group == "qpos" else f"actuator {channel}",),
                f"'{name}' jumps by {turn:.4g} ({_TURNS[turn]}) from one sample to the next, "
                f"{count} times: it wraps around, and stays within one turn",
                f"unwrap '{name}' before it is compared (numpy.unwrap, period {turn:.4g})",
                change=_Unwrapped(name, turn, middle),
            )


def _turn(column: Float[np.ndarray, " sample"]) -> float | None:
    """The period that a column wraps at; None if it does not."""
    x = column[np.isfinite(column)]
    if len(x) < 12:
        return None
    step = np.diff(x)
    for turn in _TURNS:
        jumps = np.flatnonzero(np.abs(np.abs(step) - turn) < _JUMP * turn)
        if not len(jumps) or np.ptp(x) > 1.02 * turn:
            continue
        # what does not jump moves little between samples, or anything would look like a wrap
        rest = np.delete(np.abs(step), jumps)
        low, high = x.min() + _ENDS * turn, x.max() - _ENDS * turn
        ends = np.stack([x[jumps], x[jumps + 1]])
        across = np.abs(np.abs(step[jumps]) - turn)
        if (
            ((ends.min(axis=0) < low) & (ends.max(axis=0) > high)).all()
            and rest.max(initial=0.0) < _JUMP * turn
            and across.max() <= _ON * rest.max(initial=0.0)
        ):
            return turn
    return None


def _counterpart(subject: Subject, recording: Recording, group: str, channel: str) -> float | None:
    """Where the unwrapped column should lie: about the command, or the position, of a servo."""
    for drive in subject.scene.drives if subject.scene else ():
        if drive.servo and channel == (drive.joint if group == "qpos" else drive.name):
            other = f"ctrl/{drive.name}" if group == "qpos" else f"qpos/{drive.joint}"
            if other in recording.columns and _turn(recording.columns[other]) is None:
                held = drive.held_per_command if group == "qpos" else 1.0 / drive.held_per_command
                return held * float(np.nanmedian(recording.columns[other]))
    return None


class _Unwrapped:
    """Makes a column continuous."""

    def __init__(self, name: str, turn: float, middle: float | None) -> None:
        self.name, self.turn, self.middle = name, turn, middle

    def __call__(self, recording: Recording) -> Recording:
        column = recording.columns[self.name].copy()
        ok = np.isfinite(column)
        column[ok] = np.unwrap(column[ok], period=self.turn)
        if self.middle is not None:
            away = float(np.nanmedian(column)) - self.middle
            column -= self.turn * np.round(away / self.turn)
        return replace(recording, columns={**recording.columns, self.name: column})
