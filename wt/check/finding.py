"""What an audit says, and the change that mends it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from wt.physics.scene import Amendment
from wt.types import Recording

Change = Callable[[Recording], Recording]
"""Mends a recording."""
SURE = 0.6
"""Findings that are less sure are notes: worth a look, and no fault."""


@dataclass(frozen=True)
class AuditFinding:
    """A convention that a model or a recording breaks.

    Attributes:
        kind: of fault, as in ``diagnosis.json``.
        columns: of the recording.
        elements: of the model, e.g. ``"joint elbow"``.
        evidence: in one sentence.
        fix: what to write in the map of ``wt import --map``, in the MJCF, or to record anew.
        confidence: 0…1; below :data:`SURE` it is a note.
        change: mends the recording, where that can be done.
        model_change: mends the model, where that is to blame.
        voids_commands: whether no command can be compared with anything because of it.
    """

    kind: str
    columns: tuple[str, ...]
    elements: tuple[str, ...]
    evidence: str
    fix: str
    confidence: float = 1.0
    change: Change | None = field(default=None, compare=False, repr=False)
    model_change: Amendment | None = field(default=None, compare=False, repr=False)
    voids_commands: bool = False

    @property
    def sure(self) -> bool:
        """Tell whether it is a fault, not only a note."""
        return self.confidence >= SURE

    @property
    def mended(self) -> bool:
        """Tell whether what follows is of corrected data, or of a corrected model."""
        return self.sure and (self.change is not None or self.model_change is not None)

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "kind": self.kind,
            "columns": list(self.columns),
            "elements": list(self.elements),
            "evidence": self.evidence,
            "fix": self.fix,
            "confidence": round(self.confidence, 3),
        }


def amendments(findings: Iterable[AuditFinding]) -> list[Amendment]:
    """What mends a model, of the findings that are sure of it."""
    return [f.model_change for f in findings if f.sure and f.model_change]


def leave_out(*names: str) -> Change:
    """The change that drops some columns."""

    def change(recording: Recording) -> Recording:
        kept = {n: c for n, c in recording.columns.items() if n not in names}
        return replace(recording, columns=kept)

    return change
