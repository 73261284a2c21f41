"""What changed on each unit, session after session, and since when it is as it is.

A change that was told is told once: what a unit is compared with afterwards begins with the session
that changed. Past sessions are judged by what was known on their day, each unit's last one by
everything. Where steps and a slow change raise the alarm together, the one is meant that leaves
least.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.passport.drift import TESTS, Change, Scatter, Trend, alarms, change, scatter, trend
from wt.passport.estimates import Quantity
from wt.passport.levels import Sessions

Tables = Mapping[Quantity, Sessions]
Begun = dict[Quantity, dict[str, list[str]]]
"""By quantity and unit, sessions with which something new began, in order."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The last session of a unit, in one quantity.

    Attributes:
        table: the unit's sessions.
        since: index of the first session that the last one is compared with.
        step, line: what changed, and how it goes.
        changed, drifts: whether the one, or the other, raises the alarm; never both.
        scatter_known: whether it is known how much sessions differ anyway.
    """

    table: Sessions
    since: int
    step: Change | None
    line: Trend | None
    changed: bool
    drifts: bool
    scatter_known: bool

    @property
    def alike(self) -> Sessions:
        """Sessions since the last change before, without those that are others now."""
        index = np.arange(len(self.table.keys))
        last = self.step.last if self.step and self.changed else 0
        return self.table.where((index >= self.since) & (index < len(index) - last))


def judged(tables: Tables) -> dict[str, dict[Quantity, Judged]]:
    """Every unit's last session, all its quantities together.

    Args:
        tables: of each quantity, all units' sessions.
    """
    keys = sorted({key[::-1] for table in tables.values() for key in table.keys})
    last = {q: dict(table.keys) for q, table in tables.items()}  # of a unit the last one stays
    begun: Begun = {quantity: {} for quantity in tables}
    for session, unit in keys:
        then = {q: _until(table, session) for q, table in tables.items()}
        for quantity, one in _of_unit(then, unit, begun, session).items():
            if one.changed and one.scatter_known and one.step and session != last[quantity][unit]:
                begun[quantity].setdefault(unit, []).append(one.table.keys[-one.step.last][1])
    return {unit: _of_unit(tables, unit, begun) for unit in sorted({unit for _, unit in keys})}


def _until(table: Sessions, session: str) -> Sessions:
    return table.where(np.array([key[1] <= session for key in table.keys], bool))


def _of_unit(
    tables: Tables, unit: str, begun: Begun, session: str | None = None
) -> dict[Quantity, Judged]:
    """A unit's last session; nothing of a quantity that has no estimate in ``session``."""
    mine: dict[Quantity, Sessions] = {}
    for quantity, table in tables.items():
        own = table.where(np.array([key[0] == unit for key in table.keys], bool))
        if own.keys and session in (None, own.keys[-1][1]):
            mine[quantity] = own
    since = {q: _since(own, begun[q].get(unit, [])) for q, own in mine.items()}
    base = {q: own.where(np.arange(len(own.keys)) >= since[q]) for q, own in mine.items()}
    usual = {q: scatter(tables[q], unit, begun[q]) for q in mine}
    found: dict[Quantity, dict[str, Change | Trend]] = {}
    for q, own in base.items():
        possible = {
            "step": change(own, usual[q]),
            "late": _late(own, usual[q], scatter(tables[q], unit, begun[q], 2)),
            "line": trend(own, usual[q]),
        }
        found[q] = {name: test for name, test in possible.items() if test}
    chances = {(q, name): t.p for q, tests in found.items() for name, t in tests.items()}
    raised = alarms(chances, shares={key: TESTS[key[1]] for key in chances})
    last: dict[Quantity, Judged] = {}
    for q, tests in found.items():
        names, begins = {name for of, name in raised if of == q}, since[q]
        if "step" in names and "line" not in tests:
            start = _since(mine[q], begun[q].get(unit, [])[:-1])
            if line := _steady(mine[q], start, usual[q]):
                tests, names, begins = {**tests, "line": line}, {"line"}, start
        last[q] = _judged(mine[q], begins, tests, usual[q], names)
    return last


def _steady(own: Sessions, start: int, usual: Scatter) -> Trend | None:
    """The line from before the last change on, if that was only the beginning of a slow one."""
    line = trend(own.where(np.arange(len(own.keys)) >= start), usual)
    return line if line and line.straight else None


def _late(own: Sessions, usual: Scatter, without: Scatter) -> Change | None:
    """The last two sessions, judged by the scatter without them; it has to be known."""
    found, judged = (change(own, by, 2) for by in (usual, without))
    if found is None or judged is None or (usual.freedom and not without.freedom):
        return None
    return replace(found, p=judged.p)  # what is left is compared with what other tests leave


def _since(own: Sessions, begun: Sequence[str]) -> int:
    """Index of the first session that is as the last ones were."""
    return sum(session < begun[-1] for _, session in own.keys) if begun else 0


def _judged(
    own: Sessions, since: int, tests: Mapping[str, Change | Trend], usual: Scatter, raised: set[str]
) -> Judged:
    meant = min(raised, key=lambda name: tests[name].left, default="")
    step, line = tests.get("late" if meant == "late" else "step"), tests.get("line")
    assert not isinstance(step, Trend) and not isinstance(line, Change)
    return Judged(
        own, since, step, line, meant in ("step", "late"), meant == "line", usual.freedom > 0
    )
