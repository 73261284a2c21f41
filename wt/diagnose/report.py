"""``report.html``: a diagnosis as one page that needs nothing but a browser.

Everything is inside the file: styles, drawings and charts as SVG. It follows the reader's light or
dark scheme, fits a phone, and prints.
"""

from __future__ import annotations

import difflib
import html
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import PurePath
from string import Template

from wt.diagnose import figures, words
from wt.diagnose.result import Diagnosis, Error
from wt.diagnose.robot_drawing import SHADES

_MOST_DIFF = 400
_MOST_CONSIDERED = 200


def report(diagnosis: Diagnosis) -> str:
    """The page."""
    template = resources.files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    sections: tuple[Callable[[Diagnosis], str], ...] = (
        _opening, _where, _errors, _dependence, _proof, _parameters, _confusable, _diff,
        _considered, _sources,
    )  # fmt: skip
    title = f"Diagnosis of {PurePath(diagnosis.model_path).name}"
    return Template(template).substitute(
        title=html.escape(title),
        shades=_shades(),
        body="\n".join(section(diagnosis) for section in sections),
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
    own = len(d.findings)
    said = words.sentences(d)
    items = [
        f'<li class="more">{_e(s)}</li>' if 0 < own <= i else f"<li>{_e(s)}</li>"
        for i, s in enumerate(said)
    ]
    css = "good" if d.verdict in ("no_mismatch", "explained") else "part"
    h = d.proof.holdout
    factor, unit = words.scaled(max(h.before, h.after), d.unit)
    if d.findings:
        tiles = [
            (f"{words.number(h.before * factor)} {unit}", "error before, on held-out data"),
            (f"{words.number(h.after * factor)} {unit}", "error after, with the patched model"),
            (f"{words.percent(h.ratio)} %", "of the error is left"),
        ]
    else:
        tiles = [(f"{words.number(h.before * factor)} {unit}", "error on held-out data")]
    tiles.append((f"{words.number(h.noise_floor * factor)} {unit}", "noise alone would give"))
    total = sum(r.seconds for r in d.recordings)
    tiles.append((f"{words.number(total)} s", f"of motion, {len(d.recordings)} recordings"))
    figures_ = "".join(f"<div><b>{_e(a)}</b><span>{_e(b)}</span></div>" for a, b in tiles)
    return (
        f"<header><h1>Diagnosis of <strong>{_e(d.model_path)}</strong></h1>"
        f'<ul class="lead">{"".join(items)}</ul>'
        f'<p><span class="verdict {css}">{words.VERDICTS[d.verdict]}</span>{_e(words.fit(d))}</p>'
        f'<div class="figures">{figures_}</div></header>'
    )


def _where(d: Diagnosis) -> str:
    model = figures.model_of(d)
    parts = [figures.robot(d, model)] if model is not None else []
    if d.locations:
        rows = []
        for place in d.locations:
            spans = ", ".join(
                f"{words.number(a)} to {words.number(b)} s" for a, b in place.intervals_s[:6]
            )
            more = "; ".join(filter(None, [place.condition, spans]))
            rows.append(
                f"<tr><td>{_e(str(place.at))}<br><span class=soft>{_e(more)}</span></td>"
                f'<td class="n">{words.percent(place.share)} %</td>'
                f'<td class="bars">{_bar("before", place.share)}</td></tr>'
            )
        parts.append("<div>" + _table(("place", "#share of the mismatch", ""), rows) + "</div>")
    title = "Where" if d.locations or d.findings else "The robot"
    return _section(title, "", f'<div class="grid">{"".join(parts)}</div>') if parts else ""


def _errors(d: Diagnosis) -> str:
    parts = []
    for i, trace in enumerate(figures.shown_traces(d)):
        role = "held out" if trace.role == "holdout" else "fitted"
        charts = f'<div class="grid">{"".join(figures.over_time(d, trace))}</div>'
        name = f"{_e(trace.name)}, {role}"
        if i == 0:
            parts.append(f"<h3>{name}</h3>{charts}")
        else:
            parts.append(f"<details><summary>{name}</summary>{charts}</details>")
    if not parts:
        return ""
    said = "Position simulated open loop minus recorded. The grey band is twice the noise."
    if d.locations and d.locations[0].intervals_s:
        said += " Shaded: where the mismatch is largest."
    title = "Error before and after" if d.findings else "Error over time"
    keys = figures.BEFORE_AFTER if d.findings else ""
    return _section(title, said, f"<p>{keys}</p>" * bool(keys) + "".join(parts))


def _dependence(d: Diagnosis) -> str:
    model = figures.model_of(d)
    drawn = list(dict.fromkeys(figures.dependence(d, f, model) for f in d.findings))
    if not any(drawn):
        return ""
    keys = f"<p>{figures.BEFORE_AFTER}</p>"
    said = "Force by inverse dynamics along the recording, less what the model already has."
    return _section(
        "What the missing force depends on", said, f'{keys}<div class="grid">{"".join(drawn)}</div>'
    )


def _proof(d: Diagnosis) -> str:
    proof = d.proof
    largest = max([*(e.before for e in proof.joints.values()), proof.holdout.before, 1e-30])
    rows = [_error_row(d, "all joints", proof.holdout, largest, "best")]
    rows += [_error_row(d, name, error, largest, "") for name, error in proof.joints.items()]
    _, unit = words.scaled(largest, d.unit)
    errors = ("#before", "#after", "#noise") if d.findings else ("#error", "#noise")
    left_head = ("#left",) if d.findings else ()
    head = ("joint", *(f"{e} [{unit}]" for e in errors), *left_head, "")
    ahead = figures.horizon(d)
    split = f" Held out: {proof.split}." if proof.split else ""
    said = (
        f"Root mean square errors of open-loop replays on data that nothing was fitted to.{split}"
    )
    left = "".join(f"<li>{_e(s)}</li>" for s in proof.left_over)
    left = f'<h3>Left over</h3><ul class="next">{left}</ul>' if left else ""
    ahead = f'<div class="grid">{ahead}</div>' if ahead else ""
    keys = f"<p>{figures.BEFORE_AFTER}</p>" if d.findings else ""
    body = keys + _table(head, rows) + left + ahead
    return _section("Proof" if d.findings else "Errors", said, body)


def _error_row(d: Diagnosis, name: str, e: Error, largest: float, css: str) -> str:
    factor, _ = words.scaled(largest, d.unit)
    shown = (e.before, e.after, e.noise_floor) if d.findings else (e.before, e.noise_floor)
    cells = [words.number(x * factor) for x in shown]
    bars = _bar("before", e.before / largest)
    if d.findings:
        cells.append(f"{words.percent(e.ratio)} %")
        bars += _bar("after", e.after / largest)
    return (
        f'<tr class="{css}"><td class="name">{_e(name)}</td>'
        + "".join(f'<td class="n">{_e(c)}</td>' for c in cells)
        + f'<td class="bars">{bars}</td></tr>'
    )


def _parameters(d: Diagnosis) -> str:
    if not d.findings:
        return ""
    rows = []
    for effect, at, name, value, unit, interval, warning in words.parameter_rows(d.findings):
        warned = f'<br><span class="warn">{_e(warning)}</span>' if warning else ""
        rows.append(
            f"<tr><td>{_e(at)}</td><td><code>{_e(effect)}</code></td>"
            f'<td>{_e(name)}{warned}</td><td class="n">{_e(value)}</td><td>{_e(unit)}</td>'
            f'<td class="n">{_e(interval)}</td></tr>'
        )
    table = ""
    if rows:
        head = ("place", "effect", "parameter", "#value", "unit", "#95 % interval")
        table = _table(head, rows)
    evidence = []
    for f in d.findings:
        said = (
            f"{f.at}, {f.effect}: removes {words.percent(f.holdout_gain)} % of the squared "
            f"error on held-out data; p {words.p_value(f.p_value)} over the whole search."
        )
        law = f"<br>Force: <code>{_e(f.formula)}</code>" if f.formula else ""
        inputs = f"<br>Depends on {_e(', '.join(f.depends_on))}." if f.depends_on else ""
        evidence.append(f"<li>{_e(said)}{inputs}{law}</li>")
    return _section("Parameters", "", table + f'<ul class="next">{"".join(evidence)}</ul>')


def _confusable(d: Diagnosis) -> str:
    rows = [
        f"<tr><td>{_e(str(f.at))}<br><code>{_e(f.effect)}</code></td>"
        f"<td>{_e(str(c.at))}<br><code>{_e(c.effect)}</code></td>"
        f"<td>{_e(c.separating_experiment)}</td></tr>"
        for f in d.findings
        for c in f.confusable_with
    ]
    table = _table(("found", "could also be", "what would tell"), rows) if rows else ""
    items = "".join(f"<li>{_e(s)}</li>" for s in d.suggestions)
    following = f'<h3>What to record next</h3><ul class="next">{items}</ul>' if items else ""
    if not table and not following:
        return ""
    return _section("What these recordings cannot tell apart", "", table + following)


def _diff(d: Diagnosis) -> str:
    given, patched = d.given_xml.splitlines(), d.patched_xml.splitlines()
    name = PurePath(d.model_path).name
    lines = list(difflib.unified_diff(given, patched, name, "model.xml", lineterm="", n=2))
    if not lines:
        return _section("Changes to the model", "None.", "") if not d.findings else ""
    css = {"+": "add", "-": "del", "@": "at"}
    shown = "".join(
        f'<span class="{css.get(line[:1], "")}">{_e(line) or " "}</span>'
        for line in lines[:_MOST_DIFF]
    )
    more = len(lines) - _MOST_DIFF
    rest = f"<p class=note>{more} more lines differ; see model.xml.</p>" if more > 0 else ""
    return _section(
        "Changes to the model",
        "The patched model is model.xml; it loads in plain MuJoCo.",
        f"<pre>{shown}</pre>{rest}",
    )


def _considered(d: Diagnosis) -> str:
    if not d.considered:
        return ""
    rows = [
        f"<tr{' class=best' if c.verdict == 'accepted' else ''}>"
        f"<td><code>{_e(c.effect)}</code></td>"
        f'<td>{_e(str(c.at))}</td><td class="n">{words.number(c.gain)}</td>'
        f"<td>{c.stage}</td><td>{_e(c.verdict)}</td></tr>"
        for c in d.considered[:_MOST_CONSIDERED]
    ]
    head = ("effect", "place", "#gain [nats]", "judged by", "outcome")
    return (
        f"<details><summary>{len(d.considered)} hypotheses were considered</summary>"
        f"{_table(head, rows)}</details>"
    )


def _sources(d: Diagnosis) -> str:
    rows = [
        f"<tr><td>{_e(r.path)}</td><td>{'held out' if r.role == 'holdout' else 'fitted'}</td>"
        f'<td class="n">{words.number(r.seconds)}</td>'
        f'<td class="n">{words.number(r.rate_hz)}</td></tr>'
        for r in d.recordings
    ]
    table = _table(("recording", "used as", "#length [s]", "#rate [Hz]"), rows)
    notes = "".join(f"<li>{_e(n)}</li>" for n in d.notes)
    works = dict.fromkeys(f.reference for f in d.findings if f.reference)
    references = "".join(f"<li>{_e(r)}</li>" for r in works)
    parts = [table]
    parts += [f'<h3>Notes</h3><ul class="next">{notes}</ul>'] * bool(notes)
    parts += [f'<h3>References</h3><ul class="next">{references}</ul>'] * bool(references)
    took = f" in {words.number(d.seconds)} s" if d.seconds else ""
    footer = (
        f"<footer>Made by wt diagnose{took}. Model: {_e(d.model_path)}, SHA-256 "
        f"<code>{_e(d.model_sha256)}</code>. Motion: diagnosis.rrd (wt view).</footer>"
    )
    return _section("Recordings", "", "".join(parts)) + footer


def _section(title: str, said: str, body: str) -> str:
    intro = f'<p class="soft">{_e(said)}</p>' if said else ""
    return f"<section><h2>{_e(title)}</h2>{intro}{body}</section>"


def _table(head: Sequence[str], rows: Sequence[str]) -> str:
    """A table; a heading that begins with # is of a column of numbers."""
    cells = "".join(
        f'<th scope="col" class="n">{_e(h[1:])}</th>'
        if h.startswith("#")
        else f'<th scope="col">{_e(h)}</th>'
        for h in head
    )
    whole = f"<thead><tr>{cells}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f'<div class="scroll"><table>{whole}</table></div>'


def _bar(css: str, share: float) -> str:
    return f'<span class="bar {css}" style="width:{100 * min(max(share, 0.0), 1.0):.1f}%"></span>'


def _e(text: str) -> str:
    return html.escape(text)
