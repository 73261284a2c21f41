"""A plan for people: sentences for a terminal, and a page with a matrix for each joint."""

from __future__ import annotations

import html
from collections.abc import Sequence

from wt.ask.plan import Apart, Cause, Plan
from wt.show.page import escaped, section, table, template

HARD = 3.0
"""Causes that have to be more than so many times as large as what can be seen are named."""


def sentences(plan: Plan) -> list[str]:
    """What is never told apart, and what only a larger effect tells, joint after joint."""
    said = [_sensed(plan)]
    said += [f"{cause} shows in none of these sensors" for cause in plan.unseen]
    for joint, pairs in plan.joints.items():
        hard = sorted((p for p in pairs if p.times > HARD), key=lambda p: -p.times)
        said += [f"{joint}: {_both(pair)} {_when(pair)}" for pair in hard]
    if not any(pair.times > HARD for pairs in plan.joints.values() for pair in pairs):
        said.append("Every two causes at a joint can be told apart.")
    return said


def _sensed(plan: Plan) -> str:
    """What is measured, in a sentence."""
    sensors = plan.sensors
    parts = []
    if not sensors.declared:
        parts.append("the position of every joint (the model declares no encoder)")
    elif sensors.joints:
        parts.append(f"the position of {', '.join(sensors.joints)}")
    if sensors.speeds:
        parts.append(f"the velocity of {', '.join(sensors.speeds)}")
    if sensors.bodies:
        parts.append("how bodies turn and move")
    if sensors.drives:
        parts.append(f"the force of {', '.join(sensors.drives)}")
    unused = f"; not used: {', '.join(sensors.others)}" if sensors.others else ""
    return f"Measured: {'; '.join(parts)}{unused}."


def page(plan: Plan, model: str) -> str:
    """``plan.html``.

    Args:
        plan: what can be told apart.
        model: name of the file.
    """
    never = sum(pair.never for pairs in plan.joints.values() for pair in pairs)
    lead = (
        f"{never} pairs of causes look the same in every recording."
        if never
        else "Every two causes at a joint can be told apart."
    )
    explained = (
        "How many times as large as what can just be seen two causes have to be to be told apart: "
        "1 is at once, a dash never."
    )
    parts = [
        f"<header><h1>What recordings of <strong>{escaped(model)}</strong> could tell</h1>"
        f'<ul class="lead"><li>{escaped(lead)}</li><li>{escaped(_sensed(plan))}</li></ul>'
        f'<p class="soft">{escaped(explained)}</p>'
        "</header>"
    ]
    parts += [section(f"Joint {j}", "", _motions(p) + _matrix(p)) for j, p in plan.joints.items()]
    others = ", ".join(plan.replayed)
    note = f"These have no signature in forces; only replays of recordings tell them: {others}."
    parts.append(section("Not compared", note, ""))
    if plan.unseen:
        never_seen = ", ".join(str(cause) for cause in plan.unseen)
        parts.append(section("Never shown", f"None of these sensors shows {never_seen}.", ""))
    title = html.escape(f"Plan for {model}")
    return template().substitute(title=title, shades="", body="\n".join(parts))


def _when(pair: Apart) -> str:
    if pair.never:
        return "are never told apart"
    return (
        f"only where {pair.times:.0f} times as large as what can be seen, best if it {pair.motion}"
    )


def _both(pair: Apart) -> str:
    return " and ".join(str(cause) for cause in pair.causes)


def _matrix(pairs: Sequence[Apart]) -> str:
    """Causes against causes."""
    causes = list(dict.fromkeys(c for p in pairs for c in p.causes))
    times = {frozenset(p.causes): p for p in pairs}
    names = [f"{cause.effect} {cause.at.name}" for cause in causes]
    rows = []
    for i, one in enumerate(causes):
        cells = "".join(f"<td>{_cell(times, one, other)}</td>" for other in causes[:i])
        rows.append(f"<tr><td>{escaped(names[i])}</td>{cells}</tr>")
    shown = table(["", *names[:-1]], rows, "heat")
    return f"<details><summary>All {len(pairs)} pairs</summary>{shown}</details>"


def _cell(times: dict[frozenset[Cause], Apart], one: Cause, other: Cause) -> str:
    pair = times.get(frozenset((one, other)))
    if pair is None:
        return ""
    return "<strong>–</strong>" if pair.never else f"{pair.times:.2g}"


def _motions(pairs: Sequence[Apart]) -> str:
    """The motions that tell what is hard to tell."""
    hard = sorted((p for p in pairs if p.times > HARD), key=lambda p: -p.times)
    rows = [
        f"<tr><td>{escaped(str(p.causes[0]))}</td><td>{escaped(str(p.causes[1]))}</td>"
        f'<td class="n">{"never" if p.never else f"{p.times:.2g}"}</td>'
        f"<td>{escaped(p.motion)}</td></tr>"
        for p in hard
    ]
    return table(["one", "the other", "#times", "motion"], rows) if rows else ""
