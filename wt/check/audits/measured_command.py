"""A command column that holds what was measured."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.types import Recording

_SHIFTS = (0, 1, 2, -1, -2)
_SHARE = 0.95
_EQUAL = 1e-7  # of the range


@register
class MeasuredCommand:
    """The position that was measured stands where the command belongs."""

    kinds: ClassVar[tuple[str, ...]] = ("command_is_measured",)
    stage: ClassVar[Stage] = "column"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for all columns that are of this kind."""
        recording = subject.recording
        if recording is None:
            return
        same = dict(_same(recording, subject))
        if same:
            shift = next(iter(same.values()))
            when = {0: "of the same sample", 1: "of the sample before", -1: "of the sample after"}
            yield AuditFinding(
                "command_is_measured",
                tuple(same),
                tuple(f"actuator {name.removeprefix('ctrl/')}" for name in same),
                f"'{next(iter(same))}' equals the measured position "
                f"{when.get(shift, f'{abs(shift)} samples away')}"
                + (f", and {len(same) - 1} other commands do so" if len(same) > 1 else ""),
                "log what was sent to the drives; the commands cannot be had from this recording",
                voids_commands=True,
            )


def _same(recording: Recording, subject: Subject) -> Iterable[tuple[str, int]]:
    for name, command in recording.columns.items():
        channel = name.removeprefix("ctrl/")
        if channel == name:
            continue
        joints = (
            [d.joint for d in subject.scene.drives if d.name == channel]
            if (subject.scene)
            else [channel]
        )
        for joint in joints:
            position = recording.columns.get(f"qpos/{joint}")
            shift = _shift(command, position) if position is not None else None
            if shift is not None:
                yield name, shift


def _shift(
    command: Float[np.ndarray, " sample"], position: Float[np.ndarray, " sample"]
) -> int | None:
    """Samples that a command comes behind the position that it equals; None if it does not."""
    edge = max(abs(s) for s in _SHIFTS)
    u = command[edge:-edge]
    moving = np.abs(np.diff(command))[edge - 1 : len(command) - edge - 1] > 0.0
    for shift in _SHIFTS:
        x = position[edge - shift : len(position) - edge - shift]
        both = np.isfinite(u) & np.isfinite(x) & moving
        if both.sum() < 50:
            return None
        size = float(np.ptp(x[both]))
        if size > 0.0 and np.mean(np.abs(u - x)[both] <= _EQUAL * size) > _SHARE:
            return shift
    return None
