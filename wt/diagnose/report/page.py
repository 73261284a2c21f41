"""``report.html``: a diagnosis as one page that needs nothing but a browser.

Everything is inside the file: styles, drawings and charts as SVG. It follows the reader's light or
dark scheme, fits a phone, and prints.
"""

from __future__ import annotations

import difflib
import html
from collections.abc import Callable, Sequence
from pathlib import PurePath

import numpy as np

from wt.diagnose.evidence import Translated
from wt.diagnose.observed.translation import sentences
from wt.diagnose.report import charts, text
from wt.diagnose.report.drawing import SHADES
from wt.diagnose.result import Decision, Diagnosis, Error, Finding
from wt.diagnose.thresholds import THRESHOLDS
from wt.show.charts import Axes, Series, chart
from wt.show.page import bar, escaped, items, section, table, template
from wt.types import Location

_MOST_DIFF = 400


def report(diagnosis: Diagnosis) -> str:
    """The page."""
    sections: tuple[Callable[[Diagnosis], str], ...] = (
        _opening, _where, _parameters, _dependence, _errors, proof, translation, _confusable, _diff,
        _decisions, _sources,
    )  # fmt: skip
    title = f"Diagnosis of {PurePath(diagnosis.model_path).name}"
    return template().substitute(
        title=html.escape(title),
        shades=_shades(),
        body="\n".join(part(diagnosis) for part in sections),
    )


def _shades() -> str:
    """Styles of the drawing's faces, from dark to light, plain and marked."""
    rules = []
    for i in range(SHADES):
        dark = round(46 * (1 - i / (SHADES - 1)))
        for css, base in ((f".s{i}", "robot"), (f".s{i}.hot", "before")):
            color = f"color-mix(in oklab, var(--{base}), var(--dark) {dark}%)"
            rules.append(f".robot {css} {{ fill: {color}; stroke: {color} }}")
    return "\n".join(rules)


def _opening(d: Diagnosis) -> str:
    own = len(d.audit) + len(d.findings)
    sentences = [
        f'<li class="more">{escaped(s)}</li>' if 0 < own <= i else f"<li>{escaped(s)}</li>"
        for i, s in enumerate(text.sentences(d))
    ]
    css = "good" if d.verdict in ("no_mismatch", "explained") else "part"
    shown: list[tuple[str, str, str]] = []
    for h, of in text.overall(d):
        factor, unit = text.scaled(max(h.before, h.after), of)
        noise = h.noise_floor * factor
        values = text.number(h.before * factor), text.error(h.after * factor, noise)
        before, after, floor = (f"{x} {unit}" for x in (*values, text.number(noise, 2)))
        shown.append((before, after, floor))
    before, after, floor = (", ".join(parts) for parts in zip(*shown, strict=True))
    if d.findings:
        tiles = [
            (before, "error before, on held-out data"),
            (after, f"error after, with {text.files(d)}"),
            (f"{text.percent(d.proof.holdout.ratio)} %", "of the error is left"),
        ]
    else:
        tiles = [(before, "error on held-out data")]
    tiles.append((floor, "noise alone would give"))
    total = sum(r.seconds for r in d.recordings)
    count = len({r.path for r in d.recordings})
    given = "1 recording" if count == 1 else f"{count}\N{NO-BREAK SPACE}recordings"
    tiles.append((f"{text.number(total)} s", f"of motion, in {given}"))
    figures_ = "".join(f"<div><b>{escaped(a)}</b><span>{escaped(b)}</span></div>" for a, b in tiles)
    return (
        f"<header><h1>Diagnosis of <strong>{escaped(PurePath(d.model_path).name)}</strong></h1>"
        f'<ul class="lead">{"".join(sentences)}</ul>'
        f'<p><span class="verdict {css}">{text.VERDICTS[d.verdict]}</span>'
        f"{escaped(text.fit(d))}</p>"
        f'<div class="figures">{figures_}</div></header>'
    )


def _where(d: Diagnosis) -> str:
    model = charts.model_of(d)
    parts = [charts.robot(d, model)] if model is not None else []
    if d.locations:
        rows = []
        for place in d.locations:
            more = [*filter(None, [place.condition]), *text.times(d, place.intervals)]
            below = "".join(f"<br><span class=soft>{escaped(line)}</span>" for line in more)
            rows.append(
                f"<tr><td>{escaped(str(place.at))}{below}</td>"
                f'<td class="n">{escaped(f"{text.percent(place.share)} %")}</td>'
                f'<td class="bars">{bar("before", place.share)}</td></tr>'
            )
        shares = table(("place, and when it shows", "#share of the mismatch", ""), rows)
        parts.append(f'<div class="where">{shares}</div>')
    title = "Where" if d.locations or d.findings else "The robot"
    return section(title, "", f'<div class="grid">{"".join(parts)}</div>') if parts else ""


def _parameters(d: Diagnosis) -> str:
    if not d.findings:
        return ""
    rows = []
    for effect, at, name, value, unit, interval, warning in text.parameter_rows(d.findings):
        warned = f'<br><span class="warn">{escaped(warning)}</span>' if warning else ""
        rows.append(
            f"<tr><td>{escaped(at)}</td><td><code>{escaped(effect)}</code></td>"
            f'<td>{escaped(name)}{warned}</td><td class="n">{escaped(value)}</td>'
            f"<td>{escaped(unit)}</td>"
            f'<td class="n">{escaped(interval)}</td></tr>'
        )
    head = ("place", "effect", "parameter", "#value", "unit", "#95 % interval")
    values = table(head, rows) if rows else ""
    evidence = "".join(f"<li>{_evidence(d, f)}</li>" for f in d.findings)
    gains = not all(f.lawless for f in d.findings)
    legend = "p is the chance of such a gain if the effect were not there." if gains else ""
    if len(d.proof.joints) > 1:
        legend += " Shares of squared errors count every joint alike; the error above is of all."
    body = f'{values}<ul class="next">{evidence}</ul><p class="soft">{legend}</p>'
    return section("How large, and how sure", "", body)


def _evidence(d: Diagnosis, f: Finding) -> str:
    """Evidence for a finding, and the law of an unknown one."""
    words = " ".join(escaped(said) for said in (text.gained(f), text.borne_out(d, f)) if said)
    if f.depends_on:
        words += f"<br>Depends on {escaped(', '.join(f.depends_on))}."
    if f.formula:
        words += (
            f"<br>Force: <code>{html.escape(f.formula)}</code>. {escaped(text.formula_said(f))}"
        )
    return words


def _dependence(d: Diagnosis) -> str:
    model = charts.model_of(d)
    drawn = [c for f in d.findings if (c := charts.dependence(d, f, model))]
    if not drawn:
        return ""
    # what a law takes may show in replays alone: then no force is drawn after it
    after = any("beads after" in c for c in drawn)
    keys = f"<p>{charts.BEFORE_AFTER if after else charts.BEFORE}</p>"
    intro = (
        "Force that the recorded motion demands, by inverse dynamics, less what the model supplies "
        "and contacts may supply."
    )
    drawings = f'{keys}<div class="grid">{"".join(dict.fromkeys(drawn))}</div>'
    return section("What the missing force depends on", intro, drawings)


def _errors(d: Diagnosis) -> str:
    parts = []
    for i, trace in enumerate(charts.shown_traces(d)):
        role = "held out" if trace.role == "holdout" else "fitted"
        grid = f'<div class="grid">{"".join(charts.over_time(d, trace))}</div>'
        if charts.spans(d, trace):
            at = escaped(f"Shaded: where the mismatch at {d.locations[0].at} is largest.")
            grid = f'<p class="soft">{at}</p>{grid}'
        name = f"{escaped(text.short_name(d, trace.name))}, {role}"
        if i == 0:
            parts.append(f"<h3>{name}</h3>{grid}")
        else:
            parts.append(f"<details><summary>{name}</summary>{grid}</details>")
    if not parts:
        return ""
    intro = (
        "Simulated position minus the recorded one; the simulation runs open loop, once through "
        "each recording, from its commands alone. The proof below begins anew in windows, so that "
        "its figures are others. The grey band is twice the measurement noise."
    )
    title = "Error before and after" if d.findings else "Error over time"
    keys = f"<p>{charts.BEFORE_AFTER}</p>" if d.findings else ""
    return section(title, intro, keys + "".join(parts))


def _confusable(d: Diagnosis) -> str:
    rows = [
        f"<tr><td>{escaped(str(f.at))}<br><code>{escaped(f.effect)}</code></td>"
        f"<td>{escaped(str(c.at))}<br><code>{escaped(c.effect)}</code></td>"
        f"<td>{escaped(c.separating_experiment)}</td></tr>"
        for f in d.findings
        for c in f.confusable_with
    ]
    apart = table(("found", "could also be", "what would tell"), rows) if rows else ""
    following = f"<h3>What to record next</h3>{items(d.suggestions)}" if d.suggestions else ""
    if not apart and not following:
        return ""
    return section("What these recordings cannot tell apart", "", apart + following)


def _diff(d: Diagnosis) -> str:
    given, patched = d.given_xml.splitlines(), d.patched_xml.splitlines()
    name = PurePath(d.model_path).name
    lines = list(difflib.unified_diff(given, patched, name, "model.xml", lineterm="", n=2))
    if not lines:
        return section("Changes to the model", "None.", "") if not d.findings else ""
    css = {"+": "add", "-": "del", "@": "at"}
    shown = "".join(
        f'<span class="{css.get(line[:1], "")}">{html.escape(line) or " "}</span>'
        for line in lines[:_MOST_DIFF]
    )
    more = len(lines) - _MOST_DIFF
    rest = f"<p class=note>{more} more lines differ; see model.xml.</p>" if more > 0 else ""
    return section(
        "Changes to the model",
        "The patched model is model.xml; it loads in plain MuJoCo.",
        f"<pre>{shown}</pre>{rest}",
    )


def _decisions(d: Diagnosis) -> str:
    """Every decision, one table a place: the reasons for each name and against the others."""
    if not d.decisions:
        return ""
    places: dict[Location, list[Decision]] = {}
    for decision in d.decisions:
        places.setdefault(decision.at, []).append(decision)
    claimed = [f.at for f in d.findings]
    ordered = sorted(places, key=lambda at: (at not in claimed, -_interest(places[at])))
    intro = (
        "Each effect is judged first by the force that the motion demands, the best of them by "
        "replays, and those that joined by data that they were not fitted to. Statistic and "
        "threshold are in nats unless the stage says otherwise; the documentation of "
        "diagnosis.json lists them."
    )
    tables = "".join(_decided(at, places[at], at in claimed) for at in ordered)
    count = f"{_counted(len(d.decisions), 'decision')} at {_counted(len(places), 'place')}"
    body = (
        f"<details><summary>{escaped(count)}</summary>"
        '<p><label class="filter">Show places, effects or stages that contain '
        '<input type="search" data-filter="decisions"></label></p>'
        f'<div id="decisions" class="decisions">{tables}</div></details>'
    )
    return section("Why this name, and why not another", intro, body)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _interest(decisions: Sequence[Decision]) -> int:
    """Decisions that took more than a look at the forces."""
    return sum(c.stage != "screened" for c in decisions)


def _decided(at: Location, decisions: Sequence[Decision], claimed: bool) -> str:
    rows = [
        f"<tr{' class=best' if c.kept else ''}><td><code>{escaped(c.effect)}</code></td>"
        f"<td>{c.stage}</td><td>{'stays' if c.kept else 'goes'}</td>"
        f'<td class="n">{"–" if c.statistic is None else text.number(c.statistic)}</td>'
        f'<td class="n">{text.number(c.threshold)}</td><td>{escaped(c.reason)}</td></tr>'
        for c in decisions
        if c.stage != "screened" or _interest(decisions) == 0
    ]
    head = ("effect", "stage", "outcome", "#statistic", "#threshold", "why")
    screened = len(decisions) - len(rows)
    were = "more was" if screened == 1 else "more were"
    rest = f"<p class=note>{screened} {were} screened out by forces.</p>" if screened else ""
    count = _counted(len(decisions), "decision")
    return (
        f"<details{' open' if claimed else ''}><summary>{escaped(f'{at}, {count}')}</summary>"
        f"{table(head, rows)}{rest}</details>"
    )


def _sources(d: Diagnosis) -> str:
    rows = [
        f"<tr><td>{escaped(r.path)}</td><td>{'held out' if r.role == 'holdout' else 'fitted'}</td>"
        f'<td class="n">{text.number(r.seconds)}</td>'
        f'<td class="n">{text.number(r.rate_hz)}</td></tr>'
        for r in d.recordings
    ]
    parts = [table(("recording", "used as", "#length [s]", "#rate [Hz]"), rows)]
    works = tuple(dict.fromkeys(f.reference for f in d.findings if f.reference))
    parts += [f"<h3>Notes</h3>{items(d.notes)}"] * bool(d.notes)
    parts += [f"<h3>References</h3>{items(works)}"] * bool(works)
    took = f" in {text.number(d.seconds)} s" if d.seconds else ""
    footer = (
        f"<footer>{escaped(f'Made by wt diagnose{took}. Model: {d.model_path}, SHA-256 ')}"
        f"<code>{escaped(d.model_sha256)}</code>. Motion: diagnosis.rrd (wt view).</footer>"
    )
    return section("Recordings", "", "".join(parts)) + footer


def proof(d: Diagnosis) -> str:
    """The section."""
    p = d.proof
    whose = text.PLURAL if len(d.compared) > 1 else dict.fromkeys(d.compared, "joints")
    together = [(f"all {whose[unit]}", e, unit, "best") for e, unit in text.overall(d)]
    shown = together if len(p.joints) != 1 else []
    shown += [(name, error, d.unit_of(name), "") for name, error in p.joints.items()]
    largest = {
        unit: max(1e-30, *(e.before for _, e, u, _ in shown if u == unit), 0.0)
        for unit in d.compared
    }
    rows = [_error_row(d, name, e, (largest[unit], unit), css) for name, e, unit, css in shown]
    errors = ("before", "after", "noise") if d.findings else ("error", "noise")
    units = " or ".join(text.scaled(most, unit)[1] for unit, most in largest.items())
    left_head = ("#left",) if d.findings else ()
    head = ("joint", *(f"#{e} [{units}]" for e in errors), *left_head, "")
    split = f" Held out: {p.split}." if p.split else ""
    intro = (
        f"Root mean square errors of open-loop replays on data that nothing was fitted to.{split}"
    )
    ahead = charts.horizons(d)
    parts = [
        f"<p>{charts.BEFORE_AFTER}</p>" if d.findings else "",
        table(head, rows),
        _measured(d),
        f"<h3>Left over</h3>{items(p.left_over)}" if p.left_over else "",
        f'<div class="grid">{ahead}</div>' if ahead else "",
    ]
    return section("Proof" if d.findings else "Errors", intro, "".join(parts))


def _error_row(d: Diagnosis, name: str, e: Error, scale: tuple[float, str], css: str) -> str:
    """One line of errors; the largest of its unit, and that unit, tell how they are written."""
    (largest, _), (factor, unit) = scale, text.scaled(*scale)
    if len(d.compared) > 1:
        name = f"{name} [{unit}]"
    cells = [text.number(e.before * factor), text.number(e.noise_floor * factor, 2)]
    bars = bar("before", e.before / largest)
    if d.findings:
        cells.insert(1, text.error(e.after * factor, e.noise_floor * factor))
        cells.append(f"{text.percent(e.ratio)} %")
        bars += bar("after", e.after / largest)
    return (
        f'<tr class="{css}"><td class="name">{escaped(name)}</td>'
        + "".join(f'<td class="n">{escaped(c)}</td>' for c in cells)
        + f'<td class="bars">{bars}</td></tr>'
    )


def _measured(d: Diagnosis) -> str:
    """Errors at further sensors; empty if nothing else was recorded."""
    rows = []
    for s in d.measured.sensors:
        largest = max(s.before, s.after or 0.0, 1e-30)
        factor, unit = text.scaled(largest, s.unit)
        cells = [f"{text.number(s.before * factor)} {unit}"]
        bars = bar("before", s.before / largest)
        if d.findings:
            left = ["–", "–"]
            if s.after is not None:
                share = s.after / max(s.before, 1e-30)
                left = [f"{text.number(s.after * factor)} {unit}", f"{text.percent(share)} %"]
                bars += bar("after", s.after / largest)
            cells += left
        rows.append(
            f'<tr><td class="name">{escaped(s.name)}</td>'
            + "".join(f'<td class="n">{escaped(c)}</td>' for c in cells)
            + f'<td class="bars">{bars}</td></tr>'
        )
    if not rows:
        return ""
    intro = "The same replays, at the other sensors that were recorded; nothing was fitted to them."
    if any(s.after is None for s in d.measured.sensors):
        intro += " –: forces that the replay of the patched model does not tell."
    errors = ("#before", "#after", "#left") if d.findings else ("#error",)
    shown = table(("sensor", *errors, ""), rows)
    return f'<h3>What else the robot reports</h3><p class="soft">{escaped(intro)}</p>{shown}'


_MOST = 4
"""Recordings that are drawn."""


def translation(d: Diagnosis) -> str:
    """The section; empty if no translation was given."""
    evidence = d.translated
    if evidence is None:
        return ""
    intro = (
        f"{evidence.name} saw every control step: the model's answer from the recorded state, "
        "translated, beside what the machine did."
    )
    rows = [
        _row(evidence, kind) for kind in dict.fromkeys(_kind(c.name) for c in evidence.channels)
    ]
    errors = table(("channels", "#model's answer", "#translated", "#left", ""), rows)
    drawings = "".join(_chart(d, evidence, i) for i in range(min(len(evidence.distances), _MOST)))
    return section(
        "What a trained translation says",
        intro,
        f'{items(sentences(evidence))}{errors}<div class="grid">{drawings}</div>',
    )


def _kind(name: str) -> str:
    return name.partition("/")[0]


def _row(evidence: Translated, kind: str) -> str:
    """Root mean squares over the channels of one kind."""
    mine = [c for c in evidence.channels if _kind(c.name) == kind]
    before, after = (
        float(np.sqrt(np.mean([getattr(c, which) ** 2 for c in mine])))
        for which in ("before", "after")
    )
    factor, unit = text.scaled(max(before, after), mine[0].unit)
    largest = max(before, after, 1e-30)
    share = (after / max(before, 1e-30)) ** 2
    cells = [f"{text.number(x * factor)} {unit}" for x in (before, after)]
    cells.append(f"{text.percent(share)} %")
    return (
        f'<tr><td class="name">{escaped(kind)}</td>'
        + "".join(f'<td class="n">{escaped(cell)}</td>' for cell in cells)
        + f'<td class="bars">{bar("before", before / largest)}{bar("after", after / largest)}</td>'
        + "</tr>"
    )


def _chart(d: Diagnosis, evidence: Translated, index: int) -> str:
    distance = evidence.distances[index]
    name = text.short_name(d, distance.name)
    spans = tuple((e.start, e.end) for e in evidence.events if e.recording == distance.name)
    axes = Axes(
        x="time [s]",
        y="distance of features [usual ones]",
        alt=f"How far features are from the expected ones, over time in {name}",
        spans=spans,
    )
    shown = (
        "; shaded where it stands out"
        if spans
        else f", below {THRESHOLDS.feature_stands_out:g} on average"
    )
    drawn = chart([Series("before", distance.t, distance.size)], axes)
    caption = escaped(f"{name}: distance from the feature that translation expects{shown}.")
    return f"<figure>{drawn}<figcaption>{caption}</figcaption></figure>"
