"""A passport in words and tables, the same on the terminal and on the page."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from wt.data.labels import Labels
from wt.diagnose.report.text import name_of, number, p_value, values_and_intervals
from wt.diagnose.result import Estimate
from wt.passport.card import Card, Difference, State
from wt.passport.drift import FALSE_ALARM
from wt.passport.estimates import Quantity
from wt.passport.levels import Placed
from wt.passport.parts import Part, spotless
from wt.passport.scatter import Known
from wt.physics.effect import effects

LEVELS = {
    "model": "the model",
    "load": "the load",
    "unit": "the unit",
    "session": "the session",
    "unexplained": "no level explains it",
}
"""Levels in words."""


def said(quantity: Quantity) -> str:
    """A quantity as people say it, e.g. ``"joint elbow's Coulomb friction"``."""
    name = name_of(quantity.effect)
    own = [p for p in effects()[quantity.effect].parameters if p.public]
    inner = f", {quantity.parameter}" if len(own) > 1 or own[0].axes else ""
    return f"{quantity.at}'s {name}{inner}"


def known(value: Known, measured_in: str) -> tuple[str, str]:
    """A figure and its interval, to the digits that the interval allows."""
    estimate = Estimate(value.value, measured_in, (value.low, value.high))
    ((figure, interval),) = values_and_intervals(estimate)
    return (figure if measured_in == "-" else f"{figure} {measured_in}"), interval


def changed(quantity: Quantity, state: State) -> str:
    """What changed significantly since the session before, in a sentence; "" if nothing did."""
    unit = "" if quantity.measured_in == "-" else f" {quantity.measured_in}"
    step, line = state.change, state.trend
    if step and state.changed:
        way = "rose" if step.after.value > step.before.value else "fell"
        figures = f"{number(step.before.value)} to {number(step.after.value)}{unit}"
        sentence = f"{said(quantity)} {way} from {figures} in {days(step.days)}"
        if not state.scatter_known:
            sentence += "; how much sessions differ anyway is not known yet"
    elif line and state.drifts:
        way = "rises" if line.slope.value > 0.0 else "falls"
        slope, *ends = (abs(x) for x in line.slope)
        low, high = (number(end) for end in sorted(ends))
        by = f"{number(slope)}{unit} a day (95 % interval {low} to {high})"
        sentence = f"{said(quantity)} {way} by {by}"
    else:
        return ""
    return f"{sentence[:1].upper()}{sentence[1:]}{foretold(quantity, state)}."


def foretold(quantity: Quantity, state: State) -> str:
    """When the limit is reached; "" if that is not certain."""
    if state.reached is None or state.limit is None:
        return ""
    low, high = state.reached.low, state.reached.high
    ends = f"{low:.0f} to {high:.0f}" if np.isfinite(high) else f"{low:.0f} or more"
    unit = "" if quantity.measured_in == "-" else f" {quantity.measured_in}"
    when = _date(state.history.keys[-1][1], state.reached.value)
    return (
        f"; it reaches {number(state.limit)}{unit} in {days(state.reached.value)}{when} "
        f"(95 % interval {ends})"
    )


def _date(session: str, later: float) -> str:
    """The day so many days after a session; "" if that is beyond all calendars."""
    try:
        when = datetime.datetime.fromisoformat(session) + datetime.timedelta(days=later)
    except OverflowError:
        return ""
    return f", on {when.date().isoformat()}"


def days(count: float) -> str:
    """A time in days, or in hours if it is shorter than one."""
    if count < 1.0:
        return f"{24.0 * count:.0f} hours"
    rounded = f"{count:.0f}"
    return f"{rounded} day" if rounded == "1" else f"{rounded} days"


def since(state: State) -> str:
    """What became of a quantity since the session before, in two words."""
    if state.change is None:
        return "first session"
    if state.changed:
        return "rose" if state.change.after.value > state.change.before.value else "fell"
    if state.drifts and state.trend:
        return "rises" if state.trend.slope.value > 0.0 else "falls"
    return "varies as usual" if state.varies else "unchanged"


def history(quantity: Quantity, state: State) -> str:
    """What became of a quantity over the sessions, in a sentence."""
    if state.alarm:
        return changed(quantity, state)
    name = said(quantity)
    sentence = f"{name[:1].upper()}{name[1:]}: {since(state)}"
    if state.since:
        sentence += f", since it changed on {state.history.keys[state.since][1]}"
    return f"{sentence}."


def untouched(of: Card, unit: str, parts: Sequence[Part]) -> str:
    """Parts of a unit that are as in the model, in a sentence; "" if there are none."""
    names = ", ".join(map(str, spotless(parts, of.states[unit])))
    return f"As in the model, as far as recordings show: {names}." if names else ""


def level(of: Card, quantity: Quantity) -> str:
    """Whose a quantity is, in words."""
    if of.nothing(quantity):
        return "nothing that shows"
    placed = of.levels[quantity]
    by_load = (
        " and the load" if placed.loads and placed.level not in ("load", "unexplained") else ""
    )
    return LEVELS[placed.level] + by_load


def told(placed: Placed) -> str:
    """How well left-out units and sessions are predicted, in words."""
    parts = [f"{h.inside} of {h.count} {h.what}s" for h in placed.held_out]
    return ", ".join(parts) or "–"


def sentences(of: Card, unit: str) -> list[str]:
    """What changed on a unit; one sentence that says so if nothing did."""
    found = [s for q, state in of.states[unit].items() if (s := changed(q, state))]
    sessions = {k.session for k in of.labels if k.unit == unit}
    if found:
        return found
    if len(sessions) < 2:
        return [f"{unit} has one session; what changes shows from the second on."]
    return [f"Nothing on {unit} changed significantly since the session before."]


def rule() -> str:
    """The alarm's promise."""
    return (
        f"Of the sessions in which nothing changed, at most {100 * FALSE_ALARM:g} in 100 raise a "
        "false alarm, all quantities of a unit taken together."
    )


def print_card(of: Card, units: Sequence[str], console: Console, parts: Sequence[Part]) -> None:
    """The report cards of some units, which consist of these parts."""
    for unit in units:
        console.print(Text(f"\n{unit}", "bold"))
        for sentence in sentences(of, unit):
            console.print(sentence, highlight=False)
        table = _table("at", "what", "value", "95 % interval", "belongs to", "since the last")
        for quantity, state in of.states[unit].items():
            value, interval = known(state.value, quantity.measured_in)
            cells = [str(quantity.at), what(quantity), value, interval]
            cells += [level(of, quantity), since(state)]
            table.add_row(*(Text(c, "bold" if state.alarm else "") for c in cells))
        if of.states[unit]:
            console.print(table)
        if said_of_others := untouched(of, unit, parts):
            console.print(said_of_others, highlight=False)
    console.print(rule(), highlight=False, style="dim")


def what(quantity: Quantity) -> str:
    """A quantity as people say it, without its place."""
    return said(quantity).removeprefix(f"{quantity.at}'s ")


def print_difference(found: Sequence[Difference], one: str, other: str, console: Console) -> None:
    """What two units differ by."""
    sure = [d for d in found if d.sure]
    if not found:
        console.print(f"{one} and {other} have no quantity in common.", highlight=False)
        return
    if not sure:
        console.print(f"{one} and {other} do not differ significantly.", highlight=False)
    for d in sure:
        a, b = (known(x, d.quantity.measured_in)[0] for x in (d.one, d.other))
        words = f"{said(d.quantity)} is {a} on {one} and {b} on {other}."
        console.print(words[:1].upper() + words[1:], highlight=False)
    table = _table("at", "what", one, other, "difference", "95 % interval")
    for d in found:
        unit = d.quantity.measured_in
        by, interval = known(d.by, unit)
        cells = [str(d.quantity.at), what(d.quantity)]
        cells += [known(d.one, unit)[0], known(d.other, unit)[0], by, interval]
        table.add_row(*(Text(c, "bold" if d.sure else "") for c in cells))
    console.print(table)


def print_added(of: Card, groups: Sequence[Labels], console: Console) -> None:
    """What an addition decided."""
    table = _table("at", "what", "belongs to", "value", "95 % interval", "units", "held out")
    for quantity, placed in of.levels.items():
        value, interval = known(placed.model, quantity.measured_in)
        spread = placed.unit_spread
        apart = f"±{number(spread.value, 2)}" if spread and spread.low > 0.0 else "–"
        table.add_row(str(quantity.at), what(quantity), level(of, quantity), value, interval,
                      apart, told(placed))  # fmt: skip
    console.print(f"Estimated: {', '.join(map(str, groups))}.", highlight=False)
    console.print(table if of.levels else "No effect was found in any group.", highlight=False)
    for unit, quantity, state in of.alarms:
        console.print(f"{unit}: {changed(quantity, state)}", highlight=False)


def tests(placed: Placed) -> str:
    """P-values of a quantity's tests, in words."""
    names = {"load": "loads", "session": "sessions", "unit": "units", "rest": "the rest"}
    parts = [f"{names[n]} {p_value(t.p)}" for n, t in placed.tests.items()]
    return ", ".join(parts) or "–"


def _table(*head: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for name in head:
        table.add_column(name, no_wrap="interval" in name)
    return table
