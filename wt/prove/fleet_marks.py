"""Marks of a fleet's passport: levels, changes that were told, and such as were not there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wt.errors import WorkError
from wt.passport import folder as passports
from wt.passport.estimates import GroupEstimate

SEEN = 3.0
"""A change is to be noticed if it is so many standard errors."""
LATE = 1
"""Sessions after it at most."""


@dataclass(frozen=True)
class FleetMarks:
    """What a passport said, session after session, beside what is hidden.

    Attributes:
        levels: quantity → its level and the one that was said, "" for none. Not of what changed,
            unless that was in the last session: it has no level then.
        errors: size of the change in standard errors; 0 where it has no estimate.
        after: sessions from the change to the first alarm for it; None if there was none.
        false_alarms: units in sessions with an alarm for anything else.
        unit_sessions: all of them.
    """

    levels: Mapping[str, tuple[str, str]]
    errors: float
    after: int | None
    false_alarms: int
    unit_sessions: int

    @property
    def noticed(self) -> bool:
        """True if the change was told in time."""
        return self.after is not None and self.after <= LATE

    def to_json(self) -> dict[str, Any]:
        """As in ``results.json``."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> FleetMarks:
        """Read what :meth:`to_json` wrote."""
        levels = {quantity: (true, said) for quantity, (true, said) in data["levels"].items()}
        return cls(**{**data, "levels": levels})


def mark_fleet(folder: Path, hidden: Mapping[str, Any]) -> FleetMarks:
    """Compare a passport's additions, one a session, with an answer.

    Args:
        folder: of the passport; without additions nothing was said.
        hidden: ``fleet`` of the answer.

    Raises:
        WorkError: there are more additions than sessions.
    """
    additions = passports.read(folder).additions
    if len(additions) > hidden["sessions"]:
        raise WorkError(f"'{folder}' has more additions than there were sessions")
    change, after, false = hidden["change"], None, 0
    right = (change["unit"], change["quantity"])
    for session, addition in enumerate(additions):
        alarms = {(a["unit"], a["quantity"]) for a in addition.decided["alarms"]}
        if right in alarms and session >= change["session"]:
            after = session - change["session"] if after is None else after
            alarms -= {right}
        false += len({unit for unit, _ in alarms})
    placed = additions[-1].decided["levels"] if additions else ()
    said = {e["quantity"]: e["level"] for e in placed}
    moved = change["quantity"] if change["session"] < hidden["sessions"] - 1 else ""
    return FleetMarks(
        levels={q: (lv, said.get(q, "")) for q, lv in hidden["levels"].items() if q != moved},
        errors=_errors([row for a in additions for row in a.rows], change),
        after=after,
        false_alarms=false,
        unit_sessions=hidden["units"] * hidden["sessions"],
    )


def _errors(rows: Sequence[GroupEstimate], change: Mapping[str, Any]) -> float:
    """Size of the change in standard errors of the unit's last estimate."""
    errors = {
        row.labels.session: row.error
        for row in rows
        if (row.labels.unit, str(row.quantity)) == (change["unit"], change["quantity"])
    }
    return float(change["by"]) / errors[max(errors)] if errors else 0.0
