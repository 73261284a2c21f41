"""Positions in steps that are coarser than an encoder's: rounded by the log, or by its units."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import ClassVar

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.check.signals import has, step_of
from wt.data.recording import coordinate

_COARSE = 2.0 * math.pi / 500.0
"""Rad or m: encoders have 500 lines a turn and more."""


@register
class Quantization:
    """A position moves in steps that no encoder makes."""

    kinds: ClassVar[tuple[str, ...]] = ("quantization",)
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each such column."""
        recording = subject.recording
        for name, column in (recording.columns if recording else {}).items():
            group, _, joint = name.partition("/")
            if group != "qpos" or coordinate(joint) is not None or not has(column):
                continue
            step = step_of(column)
            if step > _COARSE:
                yield AuditFinding(
                    "quantization",
                    (name,),
                    (f"joint {joint}",),
                    f"'{name}' has only values that are whole steps of {step:.4g} apart, which is "
                    "coarser than any encoder: it was rounded",
                    "log every digit of the position",
                )
