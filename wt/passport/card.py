"""What a passport says: each parameter at its level, and what changed on each unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wt.data.labels import Labels
from wt.passport.changes import Judged, judged
from wt.passport.drift import Change, Trend, alarms
from wt.passport.estimates import GroupEstimate, Quantity
from wt.passport.levels import CHANCE, Placed, Sessions, place
from wt.passport.scatter import Known, interval, pooled, quantile, two_sided


@dataclass(frozen=True, eq=False)
class State:
    """One quantity on one unit.

    Attributes:
        value: with its interval: the latest session's where it changed or sessions differ anyway,
            else the unit's, which is the model's where units do not differ.
        history: the unit's sessions, loads taken off.
        since: index of the first of them that the last one is compared with: nothing was told to
            have changed since.
        change: the last session, or the last two, against these; None if there is one only.
        trend: the line through these and the last; None if there are fewer than three.
        changed, drifts: whether the one, or the other, raises the alarm; never both.
        reached: days from the last session until the limit is reached; None if there is no limit,
            the slope is not certain, the sessions lie on no line, or it leads elsewhere.
        limit: that was given.
        scatter_known: whether it is known how much sessions differ although nothing changed.
        varies: whether sessions differ anyway.
    """

    value: Known
    history: Sessions
    since: int
    change: Change | None
    trend: Trend | None
    changed: bool = False
    drifts: bool = False
    reached: Known | None = None
    limit: float | None = None
    scatter_known: bool = True
    varies: bool = False

    @property
    def alarm(self) -> bool:
        """Whether it is no longer what it was."""
        return self.changed or self.drifts


@dataclass(frozen=True, eq=False)
class Card:
    """What a passport says.

    Attributes:
        levels: every quantity at its level, by what units have been since they last changed: of
            one that did so in its last session, by what it was before.
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
    found = judged({quantity: placed.sessions for quantity, placed in whole.items()})
    levels = {q: _placed(_alike(by_quantity[q], q, found)) for q in whole}
    states = {
        unit: {
            q: _state(levels[q], unit, j, (limits or {}).get(str(q)))
            for q, j in found.get(unit, {}).items()
        }
        for unit in sorted({k.unit for k in labels})
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


def _alike(
    rows: Sequence[GroupEstimate],
    quantity: Quantity,
    found: Mapping[str, Mapping[Quantity, Judged]],
) -> list[GroupEstimate]:
    """Estimates of every unit since it last changed; of one that changed now, those before."""
    keys = {key for mine in found.values() if quantity in mine for key in mine[quantity].alike.keys}
    return [r for r in rows if (r.labels.unit, r.labels.session) in keys]


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
    """A unit's own value and its variance, whatever the others' are; as of late, if it changes."""
    table = state.history.where(np.arange(len(state.history.keys)) >= state.since)
    if state.alarm and state.change:
        after = state.change.after
        return after.value, ((after.high - after.low) / 2.0 / quantile(None)) ** 2
    spread = placed.session_spread
    scatter = spread.value**2 if spread and placed.level == "session" else 0.0
    return pooled(table.value, table.error**2 + scatter)


def _state(placed: Placed, unit: str, found: Judged, limit: float | None) -> State:
    step, line = found.step, found.line
    moving = found.changed or found.drifts
    varies = placed.level in ("session", "unexplained")
    latest = step and (moving or varies)
    certain = found.drifts and line is not None and line.straight
    return State(
        value=step.after if step and latest else placed.units[unit],
        history=found.table,
        since=found.since,
        change=step,
        trend=line,
        changed=found.changed,
        drifts=found.drifts,
        reached=line.days_until(limit) if line and certain and limit is not None else None,
        limit=limit,
        scatter_known=found.scatter_known,
        varies=varies,
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
