"""``passport.html``: one page that needs nothing but a browser; per unit a report card."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from wt.data.labels import day
from wt.passport import text
from wt.passport.card import Card, State
from wt.passport.estimates import Quantity
from wt.passport.folder import Passport
from wt.passport.levels import Placed
from wt.passport.parts import Part, spotless
from wt.show.charts import Axes, Series, chart
from wt.show.page import escaped, items, section, table, template

PAGE = "passport.html"
MADE_BY = "Made by wt passport show"
"""Stands in every page of ours, by which an earlier one is told from anybody else's."""
_HALF = 1.96  # standard errors that a bar is long to either side


def page(passport: Passport, of: Card, units: Sequence[str], name: str) -> str:
    """The page.

    Args:
        passport: everything there is.
        of: what it says.
        units: whose report cards are shown.
        name: of the passport.
    """
    parts = [
        _opening(of, units, name),
        *(_unit(of, unit, passport.parts) for unit in units),
        _levels(of),
    ]
    return template().substitute(
        title=html.escape(f"Passport {name}"),
        shades="",
        body="\n".join([*parts, _sources(passport)]),
    )


def _opening(of: Card, units: Sequence[str], name: str) -> str:
    found = [(unit, text.changed(q, s)) for unit, q, s in of.alarms if unit in units]
    lead = [f"{unit}: {sentence}" for unit, sentence in found]
    first = all(len({k.session for k in of.labels if k.unit == u}) < 2 for u in units)
    lead = lead or [
        "What changes shows from the second session on."
        if first
        else "Nothing changed significantly since the sessions before."
    ]
    css, word = ("part", f"{len(found)} changed") if found else ("good", "unchanged")
    word = "first session" if first else word
    lines = "".join(
        f"<li{' class=more' if i else ''}>{escaped(s)}</li>" for i, s in enumerate(lead)
    )
    count = len([k for k in of.labels if k.unit in units])
    return (
        f"<header><h1>Passport <strong>{escaped(name)}</strong></h1>"
        f'<ul class="lead">{lines}</ul><p><span class="verdict {css}">{word}</span> '
        f"{escaped(_counted(len(units), 'unit'))}, {escaped(_counted(count, 'group'))} of "
        f'recordings</p><p class="soft">{escaped(text.rule())}</p></header>'
    )


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _unit(of: Card, unit: str, parts: Sequence[Part]) -> str:
    states = of.states[unit]
    rows = [_row(of, q, s) for q, s in states.items()]
    rows += [
        f"<tr><td>{escaped(str(part))}</td><td>as in the model</td>{'<td></td>' * 4}</tr>"
        for part in spotless(parts, states)
    ]
    head = ("place", "what", "#value", "#95 % interval", "belongs to", "since the last")
    cards = table(head, rows) if rows else "<p>No effect was found in its recordings.</p>"
    drawn = "".join(_history(q, s) for q, s in states.items() if len(s.history.value) > 1)
    grid = f'<h3>History</h3><div class="grid">{drawn}</div>' if drawn else ""
    return section(unit, "", f"{items(text.sentences(of, unit))}{cards}{grid}")


def _row(of: Card, quantity: Quantity, state: State) -> str:
    value, interval = text.known(state.value, quantity.measured_in)
    what = text.what(quantity)
    return (
        f"<tr{' class=best' if state.alarm else ''}><td>{escaped(str(quantity.at))}</td>"
        f'<td>{escaped(what)}</td><td class="n">{escaped(value)}</td>'
        f'<td class="n">{escaped(interval)}</td><td>{escaped(text.level(of, quantity))}</td>'
        f"<td>{escaped(text.since(state))}</td></tr>"
    )


def _history(quantity: Quantity, state: State) -> str:
    """Values over sessions, a bar for each interval."""
    days = np.array([day(session) for _, session in state.history.keys])
    x, y = days - days[0], state.history.value
    half = _HALF * state.history.error
    # a gap after each bar keeps it from being joined to the next
    gaps = np.full(len(x), np.nan)
    bars = Series(
        "after",
        np.stack([x, x, x], axis=1).ravel(),
        np.stack([y - half, y + half, gaps], axis=1).ravel(),
    )
    series = [bars, Series("after", x, y, "beads")]
    if state.alarm:
        series.append(Series("before", x[-1:], y[-1:], "beads"))
    label = f"{quantity.parameter} [{quantity.measured_in}]"
    name = text.said(quantity)
    first = state.history.keys[0][1]
    axes = Axes(f"days since {first}", label, f"{name} over sessions")
    said = text.history(quantity, state)
    return f"<figure>{chart(series, axes)}<figcaption>{escaped(said)}</figcaption></figure>"


def _levels(of: Card) -> str:
    rows = [_level_row(of, q, placed) for q, placed in of.levels.items()]
    if not rows:
        return ""
    notes = list(dict.fromkeys(note for placed in of.levels.values() for note in placed.notes))
    intro = (
        "A quantity stands at the highest level at which it has one value, but for last sessions "
        "in which it rose or fell. What belongs to the model is best written into the MJCF. Held "
        "out: how many units, and sessions, lie in the 95 % interval that the others predict."
    )
    head = ("place", "what", "belongs to", "#value", "#95 % interval", "p that they are the same",
            "held out")  # fmt: skip
    return section("Whose is it", intro, table(head, rows) + (items(notes) if notes else ""))


def _level_row(of: Card, quantity: Quantity, placed: Placed) -> str:
    value, interval = text.known(placed.model, quantity.measured_in)
    what = text.what(quantity)
    loads = "".join(
        f"<br>{escaped(f'{load} adds {text.known(k, quantity.measured_in)[0]}')}"
        for load, k in placed.loads.items()
    )
    return (
        f"<tr><td>{escaped(str(quantity.at))}</td><td>{escaped(what)}</td>"
        f"<td>{escaped(text.level(of, quantity))}{loads}</td>"
        f'<td class="n">{escaped(value)}</td><td class="n">{escaped(interval)}</td>'
        f"<td>{escaped(text.tests(placed))}</td><td>{escaped(text.told(placed))}</td></tr>"
    )


def _sources(passport: Passport) -> str:
    rows = [
        f"<tr><td>{escaped(s.labels.unit)}</td><td>{escaped(s.labels.session)}</td>"
        f"<td>{escaped(s.labels.load)}</td><td>{escaped(s.path)}</td></tr>"
        for s in sorted(passport.sources, key=lambda s: (s.labels, s.path))
    ]
    notes = [note for a in passport.additions for note in a.notes]
    body = table(("unit", "session", "load", "recording"), rows)
    body += f"<h3>Notes</h3>{items(notes)}" if notes else ""
    model = passport.additions[-1]
    listed = f"<details><summary>{len(rows)} in all</summary>{body}</details>"
    footer = f"<footer>{MADE_BY}. Model: {escaped(model.model)}, SHA-256 "
    footer += f"<code>{model.model_sha256}</code></footer>"
    return section("Recordings", "", listed) + footer
