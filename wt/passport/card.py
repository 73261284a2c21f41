"""What a passport says: each parameter at its level, and what changed on each unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wt.data.labels import Labels
from wt.passport.drift import Change, Trend, alarms, change, scatter, trend
from wt.passport.estimates import GroupEstimate, Quantity
from wt.passport.levels import CHANCE, Placed, Sessions, place
from wt.passport.scatter import Known, interval, pooled, two_sided


@dataclass(frozen=True, eq=False)
class State:
    """One quantity on one unit.

    Attributes:
        value: with its interval: the latest session's where it changed or sessions differ anyway,
            else the unit's, which is the model's where units do not differ.
        history: the unit's sessions, loads taken off.
        change: the last session against the earlier ones; None if there is one only.
        trend: the line through all sessions; None if there are fewer than three.
        changed, drifts: whether the one, or the other, raises the alarm.
        reached: days from the last session until the limit is reached; None if there is no limit,
            the slope is not certain, or it leads elsewhere.
        limit: that was given.
        scatter_known: whether it is known how much sessions differ although nothing changed.
    """

    value: Known
    history: Sessions
    change: Change | None
    trend: Trend | None
    changed: bool = False
    drifts: bool = False
    reached: Known | None = None
    limit: float | None = None
    scatter_known: bool = True

    @property
    def alarm(self) -> bool:
        """Whether it is no longer what it was."""
        return self.changed or self.drifts


@dataclass(frozen=True, eq=False)
class Card:
    """What a passport says.

    Attributes:
        levels: every quantity at its level, by sessions that did not change: of one that did, the
            last is left out.
        states: by unit and quantity.
        neutral: value at which a quantity is nothing, where it has one.
        labels: every group.
    """

    levels: Mapping[Quantity, Placed]
    states: Mapping[str, Mapping[Quantity, State]]
    neutral: Mapping[Quantity, float | None]
    labels: tuple[Labels, ...]

    @property
    def alarms(self) -> list[tuple[str, Quantity, State]]:
        """What changed, unit by unit."""
        return [
            (unit, quantity, state)
            for unit, states in self.states.items()
            for quantity, state in states.items()
            if state.alarm
        ]

    def nothing(self, quantity: Quantity) -> bool:
        """Whether a quantity is the model's own and may be nothing there."""
        neutral, placed = self.neutral[quantity], self.levels[quantity]
        held = neutral is not None and placed.model.low <= neutral <= placed.model.high
        return placed.level == "model" and held

    def to_json(self) -> dict[str, Any]:
        """As in the passport's JSON files; nothing of it is infinite."""
        return {
            "levels": [_level_json(q, p) for q, p in self.levels.items()],
            "alarms": [_alarm_json(*found) for found in self.alarms],
        }


def card(
    rows: Sequence[GroupEstimate],
    limits: Mapping[str, float] | None = None,
    groups: Sequence[Labels] = (),
) -> Card:
    """Decide on all estimates of a passport.

    Args:
        rows: the latest estimate of each quantity in each group.
        limits: values of quantities, by name, whose day is asked for.
        groups: further ones, in which nothing was found.
    """
    labels = tuple(sorted({r.labels for r in rows} | set(groups)))
    by_quantity: dict[Quantity, list[GroupEstimate]] = {}
    for row in rows:
        if not row.warning:
            by_quantity.setdefault(row.quantity, []).append(row)
    whole = {quantity: _placed(mine) for quantity, mine in sorted(by_quantity.items())}
    judged = {unit: _judged(whole, unit) for unit in sorted({k.unit for k in labels})}
    levels = {
        quantity: _placed(_unmoved(by_quantity[quantity], quantity, judged)) for quantity in whole
    }
    states = {
        unit: {q: _state(levels[q], unit, j, (limits or {}).get(str(q))) for q, j in mine.items()}
        for unit, mine in judged.items()
    }
    return Card(
        levels,
        states,
        {q: mine[0].neutral for q, mine in by_quantity.items()},
        labels,
    )


def _placed(rows: Sequence[GroupEstimate]) -> Placed:
    return place(
        [r.labels for r in rows],
        np.array([r.value for r in rows]),
        np.array([r.error for r in rows]),
    )


@dataclass(frozen=True, eq=False)
class _Judged:
    """The last session of a unit, in one quantity.

    Attributes:
        table: the unit's sessions.
        step, line: what changed, and how it goes.
        changed, drifts: whether either raises the alarm.
        scatter_known: whether it is known how much sessions differ anyway.
    """

    table: Sessions
    step: Change | None
    line: Trend | None
    changed: bool
    drifts: bool
    scatter_known: bool


def _judged(levels: Mapping[Quantity, Placed], unit: str) -> dict[Quantity, _Judged]:
    """All quantities of a unit's last session, judged together."""
    mine = {q: _of_unit(p, unit) for q, p in levels.items() if unit in p.sessions.units}
    usual = {q: scatter(levels[q].sessions, unit) for q in mine}
    steps = {q: change(table, usual[q]) for q, table in mine.items()}
    lines = {q: trend(table, usual[q]) for q, table in mine.items()}
    raised = alarms(
        {(q, "step"): c.p for q, c in steps.items() if c}
        | {(q, "line"): t.p for q, t in lines.items() if t}
    )
    return {
        q: _Judged(
            table,
            steps[q],
            lines[q],
            (q, "step") in raised,
            (q, "line") in raised,
            usual[q].freedom > 0,
        )
        for q, table in mine.items()
    }


def _unmoved(
    rows: Sequence[GroupEstimate],
    quantity: Quantity,
    judged: Mapping[str, Mapping[Quantity, _Judged]],
) -> list[GroupEstimate]:
    """Estimates without the last sessions that changed: one that did says nothing of the others."""
    moved = {
        mine[quantity].table.keys[-1]
        for mine in judged.values()
        if quantity in mine and mine[quantity].changed
    }
    return [r for r in rows if (r.labels.unit, r.labels.session) not in moved]


@dataclass(frozen=True)
class Difference:
    """What two units differ by.

    Attributes:
        quantity: what.
        one, other: each unit's own value, over all its sessions.
        by: the other less the one.
        sure: whether they differ, with all quantities judged together.
    """

    quantity: Quantity
    one: Known
    other: Known
    by: Known
    sure: bool


def differences(of: Card, one: str, other: str) -> list[Difference]:
    """What two units differ by, in every quantity that both have; what is sure comes first."""
    both = [q for q in of.levels if q in of.states[one] and q in of.states[other]]
    found: dict[Quantity, tuple[Known, Known, Known]] = {}
    chances: dict[Quantity, float] = {}
    for quantity in both:
        placed = of.levels[quantity]
        (a, va), (b, vb) = (_own(placed, of.states[unit][quantity]) for unit in (one, other))
        freedom = placed.session_freedom if placed.level == "session" else None
        found[quantity] = (
            interval(a, va, freedom),
            interval(b, vb, freedom),
            interval(b - a, va + vb, freedom),
        )
        chances[quantity] = two_sided(abs(b - a) / float(np.sqrt(va + vb)), freedom)
    sure = alarms(chances, CHANCE)
    rows = [Difference(q, *three, q in sure) for q, three in found.items()]
    return sorted(rows, key=lambda d: (not d.sure, chances[d.quantity]))


def _own(placed: Placed, state: State) -> tuple[float, float]:
    """A unit's own value and its variance, whatever the others' are; as of late, if it changed."""
    table = state.history
    if state.changed:
        return float(table.value[-1]), float(table.error[-1] ** 2)
    spread = placed.session_spread
    scatter = spread.value**2 if spread and placed.level == "session" else 0.0
    return pooled(table.value, table.error**2 + scatter)


def _of_unit(placed: Placed, unit: str) -> Sessions:
    table = placed.sessions
    return table.where(np.array([key[0] == unit for key in table.keys], bool))


def _state(placed: Placed, unit: str, judged: _Judged, limit: float | None) -> State:
    step, line, table = judged.step, judged.line, judged.table
    moving = judged.changed or judged.drifts
    latest = step and (moving or placed.level in ("session", "unexplained"))
    return State(
        value=step.after if step and latest else placed.units[unit],
        history=table,
        change=step,
        trend=line,
        changed=judged.changed,
        drifts=judged.drifts,
        reached=line.days_until(limit) if line and judged.drifts and limit is not None else None,
        limit=limit,
        scatter_known=judged.scatter_known,
    )


def _level_json(quantity: Quantity, placed: Placed) -> dict[str, Any]:
    return {
        "quantity": str(quantity),
        "unit_of_measurement": quantity.measured_in,
        "level": placed.level,
        "model": _known_json(placed.model),
        "units": {unit: _known_json(known) for unit, known in placed.units.items()},
        "loads": {load: _known_json(known) for load, known in placed.loads.items()},
        "unit_spread": _known_json(placed.unit_spread),
        "session_spread": _known_json(placed.session_spread),
        "tests": {
            name: {"statistic": t.statistic, "freedom": list(t.freedom), "p": t.p}
            for name, t in placed.tests.items()
        },
        "held_out": [{"what": h.what, "count": h.count, "inside": h.inside}
                     for h in placed.held_out],
        "notes": list(placed.notes),
    }  # fmt: skip


def _alarm_json(unit: str, quantity: Quantity, state: State) -> dict[str, Any]:
    found: dict[str, Any] = {"unit": unit, "quantity": str(quantity)}
    if state.change:
        found |= {
            "before": _known_json(state.change.before),
            "after": _known_json(state.change.after),
            "days": state.change.days,
            "p_change": state.change.p,
        }
    if state.trend:
        found |= {"per_day": _known_json(state.trend.slope), "p_trend": state.trend.p}
    return found


def _known_json(known: Known | None) -> dict[str, Any] | None:
    if known is None:
        return None
    low, high = (end if np.isfinite(end) else None for end in (known.low, known.high))
    return {"value": known.value, "ci95": [low, high]}
