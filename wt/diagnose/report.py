"""``report.html``: a diagnosis as one page that needs nothing but a browser.

Everything is inside the file: styles, drawings and charts as SVG. It follows the reader's light or
dark scheme, fits a phone, and prints.
"""

from __future__ import annotations

import difflib
import html
from collections.abc import Callable
from importlib import resources
from pathlib import PurePath
from string import Template

from wt.diagnose import figures, words
from wt.diagnose.page import bar, items, section, table, text
from wt.diagnose.report_proof import proof
from wt.diagnose.report_translation import translation
from wt.diagnose.result import Diagnosis, Finding
from wt.diagnose.robot_drawing import SHADES

_MOST_DIFF = 400
_MOST_CONSIDERED = 200


def report(diagnosis: Diagnosis) -> str:
    """The page."""
    template = resources.files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    sections: tuple[Callable[[Diagnosis], str], ...] = (
        _opening, _where, _parameters, _dependence, _errors, proof, translation, _confusable, _diff,
        _considered, _sources,
    )  # fmt: skip
    title = f"Diagnosis of {PurePath(diagnosis.model_path).name}"
    return Template(template).substitute(
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
    own = len(d.findings)
    said = [
        f'<li class="more">{text(s)}</li>' if 0 < own <= i else f"<li>{text(s)}</li>"
        for i, s in enumerate(words.sentences(d))
    ]
    css = "good" if d.verdict in ("no_mismatch", "explained") else "part"
    h = d.proof.holdout
    factor, unit = words.scaled(max(h.before, h.after), d.unit)
    noise = h.noise_floor * factor
    if d.findings:
        tiles = [
            (f"{words.number(h.before * factor)} {unit}", "error before, on held-out data"),
            (
                f"{words.error(h.after * factor, noise)} {unit}",
                "error after, with the patched model",
            ),
            (f"{words.percent(h.ratio)} %", "of the error is left"),
        ]
    else:
        tiles = [(f"{words.number(h.before * factor)} {unit}", "error on held-out data")]
    tiles.append((f"{words.number(noise, 2)} {unit}", "noise alone would give"))
    total = sum(r.seconds for r in d.recordings)
    count = len({r.path for r in d.recordings})
    given = "1 recording" if count == 1 else f"{count}\N{NO-BREAK SPACE}recordings"
    tiles.append((f"{words.number(total)} s", f"of motion, in {given}"))
    figures_ = "".join(f"<div><b>{text(a)}</b><span>{text(b)}</span></div>" for a, b in tiles)
    return (
        f"<header><h1>Diagnosis of <strong>{text(PurePath(d.model_path).name)}</strong></h1>"
        f'<ul class="lead">{"".join(said)}</ul>'
        f'<p><span class="verdict {css}">{words.VERDICTS[d.verdict]}</span>'
        f"{text(words.fit(d))}</p>"
        f'<div class="figures">{figures_}</div></header>'
    )


def _where(d: Diagnosis) -> str:
    model = figures.model_of(d)
    parts = [figures.robot(d, model)] if model is not None else []
    if d.locations:
        rows = []
        for place in d.locations:
            more = [*filter(None, [place.condition]), *words.times(d, place.intervals)]
            below = "".join(f"<br><span class=soft>{text(line)}</span>" for line in more)
            rows.append(
                f"<tr><td>{text(str(place.at))}{below}</td>"
                f'<td class="n">{text(f"{words.percent(place.share)} %")}</td>'
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
    for effect, at, name, value, unit, interval, warning in words.parameter_rows(d.findings):
        warned = f'<br><span class="warn">{text(warning)}</span>' if warning else ""
        rows.append(
            f"<tr><td>{text(at)}</td><td><code>{text(effect)}</code></td>"
            f'<td>{text(name)}{warned}</td><td class="n">{text(value)}</td><td>{text(unit)}</td>'
            f'<td class="n">{text(interval)}</td></tr>'
        )
    head = ("place", "effect", "parameter", "#value", "unit", "#95 % interval")
    found = table(head, rows) if rows else ""
    evidence = "".join(f"<li>{_evidence(d, f)}</li>" for f in d.findings)
    said = "p is the chance of such a gain if the effect were not there."
    body = f'{found}<ul class="next">{evidence}</ul><p class="soft">{said}</p>'
    return section("How large, and how sure", "", body)


def _evidence(d: Diagnosis, f: Finding) -> str:
    """What speaks for a finding, and the law of an unknown one."""
    p = words.p_value(f.p_value)
    name = words.name_of(f.effect)
    parts = [
        text(
            f"{name[:1].upper()}{name[1:]} at {f.at} removes {words.percent(f.holdout_gain)} % of "
            f"the squared error on held-out data (p {p if p.startswith('<') else f'= {p}'})."
        ),
        text(words.borne_out(d, f)),
    ]
    said = " ".join(filter(None, parts))
    if f.depends_on:
        said += f"<br>Depends on {text(', '.join(f.depends_on))}."
    return said + (f"<br>Force: <code>{html.escape(f.formula)}</code>" if f.formula else "")


def _dependence(d: Diagnosis) -> str:
    model = figures.model_of(d)
    drawn = [c for f in d.findings if (c := figures.dependence(d, f, model))]
    if not drawn:
        return ""
    keys = f"<p>{figures.BEFORE_AFTER}</p>"
    said = (
        "Force that the recorded motion demands, by inverse dynamics, less what the model supplies."
    )
    charts = f'{keys}<div class="grid">{"".join(dict.fromkeys(drawn))}</div>'
    return section("What the missing force depends on", said, charts)


def _errors(d: Diagnosis) -> str:
    parts = []
    for i, trace in enumerate(figures.shown_traces(d)):
        role = "held out" if trace.role == "holdout" else "fitted"
        charts = f'<div class="grid">{"".join(figures.over_time(d, trace))}</div>'
        if figures.spans(d, trace):
            at = text(f"Shaded: where the mismatch at {d.locations[0].at} is largest.")
            charts = f'<p class="soft">{at}</p>{charts}'
        name = f"{text(words.short_name(d, trace.name))}, {role}"
        if i == 0:
            parts.append(f"<h3>{name}</h3>{charts}")
        else:
            parts.append(f"<details><summary>{name}</summary>{charts}</details>")
    if not parts:
        return ""
    said = (
        "Simulated position minus the recorded one; the simulation runs open loop, from the "
        "recorded commands alone. The grey band is twice the measurement noise."
    )
    title = "Error before and after" if d.findings else "Error over time"
    keys = f"<p>{figures.BEFORE_AFTER}</p>" if d.findings else ""
    return section(title, said, keys + "".join(parts))


def _confusable(d: Diagnosis) -> str:
    rows = [
        f"<tr><td>{text(str(f.at))}<br><code>{text(f.effect)}</code></td>"
        f"<td>{text(str(c.at))}<br><code>{text(c.effect)}</code></td>"
        f"<td>{text(c.separating_experiment)}</td></tr>"
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


def _considered(d: Diagnosis) -> str:
    if not d.considered:
        return ""
    by = {"screened": "forces", "replayed": "replays"}
    rows = [
        f"<tr{' class=best' if c.verdict == 'accepted' else ''}>"
        f"<td><code>{text(c.effect)}</code></td>"
        f'<td>{text(str(c.at))}</td><td class="n">{words.number(c.gain)}</td>'
        f"<td>{by[c.stage]}</td><td>{text(c.verdict)}</td></tr>"
        for c in d.considered[:_MOST_CONSIDERED]
    ]
    head = ("effect", "place", "#gain [nats]", "judged by", "outcome")
    said = (
        "Gain: of log-likelihood over the model without it, less the price of its parameters. "
        "Judged first by the force that the motion demands, the best then by replays."
    )
    return (
        f"<details><summary>{len(d.considered)} hypotheses were considered</summary>"
        f'<p class="soft">{text(said)}</p>{table(head, rows)}</details>'
    )


def _sources(d: Diagnosis) -> str:
    rows = [
        f"<tr><td>{text(r.path)}</td><td>{'held out' if r.role == 'holdout' else 'fitted'}</td>"
        f'<td class="n">{words.number(r.seconds)}</td>'
        f'<td class="n">{words.number(r.rate_hz)}</td></tr>'
        for r in d.recordings
    ]
    parts = [table(("recording", "used as", "#length [s]", "#rate [Hz]"), rows)]
    works = tuple(dict.fromkeys(f.reference for f in d.findings if f.reference))
    parts += [f"<h3>Notes</h3>{items(d.notes)}"] * bool(d.notes)
    parts += [f"<h3>References</h3>{items(works)}"] * bool(works)
    took = f" in {words.number(d.seconds)} s" if d.seconds else ""
    footer = (
        f"<footer>{text(f'Made by wt diagnose{took}. Model: {d.model_path}, SHA-256 ')}"
        f"<code>{text(d.model_sha256)}</code>. Motion: diagnosis.rrd (wt view).</footer>"
    )
    return section("Recordings", "", "".join(parts)) + footer
