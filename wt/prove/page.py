"""``report.html`` of a trial: scores, confusions, power, calibration and every case, on one page.

The page needs nothing but a browser; it shares styles and pieces with the report of a diagnosis.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from wt.prove.page_tables import cases, confusion, first, machines
from wt.prove.results import LABELS, Results, cell, title
from wt.prove.tally import SEEN
from wt.show.charts import Axes, Series, chart
from wt.show.page import escaped, section, table, template

STYLE = """<style>
.heat .same { outline: 2px solid var(--ok); outline-offset: -2px }
.strip { width: 320px; max-width: 100% } .strip .axis { stroke: var(--line) }
.strip .limit { stroke: var(--soft); stroke-dasharray: 2 3 }
.strip .hit { fill: var(--after) }
.strip .miss { fill: none; stroke: var(--before); stroke-width: 2 }
.strip .near { fill: none; stroke: var(--after); stroke-width: 2 }
.ok { color: var(--ok) } .bad { color: var(--warn) }
</style>"""
_LOW, _HIGH = 0.1, 1e4
"""Ends of the scale of effect over noise."""
_BINS = np.array([0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e4])


def page(results: Results) -> str:
    """The page, for ``results.json``."""
    parts: tuple[Callable[[Results], str], ...] = (
        _opening, _scores, machines, _power, confusion, _calibration, cases, _sealed,
    )  # fmt: skip
    body = "\n".join(part(results) for part in parts)
    return template().substitute(title="Trial of wt diagnose", shades="", body=STYLE + body)


def _opening(results: Results) -> str:
    who = first(results)
    scores = results["scores"][who]
    place, effect, alarms = (scores[k] for k in ("location", "effect", "false_alarms"))
    said = []
    if place["of"]:
        said.append(
            f"Found the place of {place['right']} of {place['of']} hidden effects, and named "
            f"{effect['right']} of {effect['of']} that are in its vocabulary."
        )
    if alarms["of"]:
        said.append(
            f"Accused {alarms['right']} of {alarms['of']} machines in which nothing is hidden."
        )
    tiles = "".join(
        f"<div><b>{escaped(cell(name, scores[name]))}</b><span>{escaped(LABELS[name])}</span></div>"
        for name in ("location", "effect", "false_alarms", "coverage", "unknown", "error_left")
        if cell(name, scores[name]) != "–"
    )
    what = f"set {results['set']}, seed {results['seed']}" if results["set"] else "cases of others"
    return (
        f"<header><h1>Trial of <strong>{escaped(title(who))}</strong> on {len(results['cases'])} "
        f'concealed cases, {escaped(what)}</h1><ul class="lead">'
        f"{''.join(f'<li>{escaped(s)}</li>' for s in said)}</ul>"
        f'<div class="figures">{tiles}</div></header>'
    )


def _scores(results: Results) -> str:
    contenders = list(results["scores"])
    wanted = {t["score"]: t for t in results["targets"]}
    rows = []
    for name, label in LABELS.items():
        scores = [results["scores"][who].get(name) for who in contenders]
        cells = [cell(name, score) for score in scores]
        if all(c == "–" for c in cells):
            continue
        target = wanted.get(name)
        goal, css = "", ""
        if target is not None:
            goal = f"{100 * target['from']:.0f} to {100 * target['to']:.0f} %"
            css = {True: " ok", False: " bad", None: ""}[target["met"]]
        rows.append(
            f'<tr><td class="name">{escaped(label)}</td>{_of(scores[0])}'
            + "".join(
                f'<td class="n{css if i == 0 else ""}">{escaped(c)}</td>'
                for i, c in enumerate(cells)
            )
            + f'<td class="n">{escaped(goal)}</td></tr>'
        )
    head = ("", "#of", "#95 % interval", *(f"#{title(who)}" for who in contenders), "#wanted")
    said = (
        f"Places and effects count where the effect changes the recordings by more than {SEEN:g} "
        "times their noise. Held-out errors are those of the patched MJCF in plain MuJoCo, "
        f"intervals those of {title(contenders[0])}."
    )
    return section("Scores", said, table(head, rows))


def _of(score: object) -> str:
    """Cells with the number of cases behind a share and its interval; empty for other scores."""
    if not isinstance(score, dict) or score["ci95"] is None:
        return '<td class="n"></td>' * 2
    low, high = (100 * end for end in score["ci95"])
    interval = escaped(f"{low:.0f} to {high:.0f} %")
    return f'<td class="n">{score["of"]}</td><td class="n">{interval}</td>'


def _power(results: Results) -> str:
    who = first(results)
    laws: Mapping[str, Sequence[Mapping[str, Any]]] = results["power"][who]
    if not laws:
        return ""
    points = [point for of_law in laws.values() for point in of_law]
    size = np.array([p["visibility"] for p in points])
    rows = []
    for law, of_law in sorted(laws.items()):
        located, named = (sum(p[key] for p in of_law) for key in ("located", "named"))
        rows.append(
            f"<tr><td><code>{html.escape(law)}</code></td><td>{_strip(of_law)}</td>"
            f'<td class="n">{located} of {len(of_law)}</td>'
            f'<td class="n">{named} of {len(of_law)}</td></tr>'
        )
    series = []
    for css, key in (("before", "located"), ("after", "named")):
        x, y = _rates(size, np.array([p[key] for p in points], dtype=float))
        series.append(Series(css, x, y, "beads"))
    ends = np.log10([size.min() + 1e-9, size.max() + 1e-9])
    series.append(Series("grid", ends, np.zeros(2)))  # the scale starts at nothing found
    axes = Axes(
        "log₁₀ of effect over noise", "share found", "Share of effects that were located and named"
    )
    keys = '<p><span class="key before">located</span><span class="key after">named</span></p>'
    said = (
        "Each hidden effect by its size: the change of recorded positions over their noise. "
        "Full: named. Ring: located, named otherwise. Orange: missed. Dotted: three times the "
        "noise."
    )
    head = ("effect", "from 0.1 to 10 000 times the noise", "#located", "#named")
    figure = f'<div class="grid"><figure>{chart(series, axes)}{keys}</figure></div>'
    return section("Power", said, figure + table(head, rows))


def _rates(
    size: Float[np.ndarray, " point"], hit: Float[np.ndarray, " point"]
) -> tuple[Float[np.ndarray, " bin"], Float[np.ndarray, " bin"]]:
    """Middles of bins of size and the share of hits in each that is not empty."""
    which = np.digitize(np.clip(size, _LOW, _HIGH * 0.999), _BINS) - 1
    used = [i for i in range(len(_BINS) - 1) if (which == i).any()]
    middle = [float(np.log10(size[which == i] + 1e-9).mean()) for i in used]
    return np.array(middle), np.array([float(hit[which == i].mean()) for i in used])


def _strip(points: Sequence[Mapping[str, Any]]) -> str:
    """Effects of one kind along a logarithmic line of their sizes."""

    def at(size: float) -> float:
        share = math.log(min(max(size, _LOW), _HIGH) / _LOW) / math.log(_HIGH / _LOW)
        return 8.0 + 304.0 * share

    dots = "".join(
        f'<circle class="{"hit" if p["named"] else "near" if p["located"] else "miss"}" '
        f'cx="{at(p["visibility"]):.1f}" cy="10" r="4.5"><title>{p["visibility"]:.3g}</title>'
        "</circle>"
        for p in points
    )
    return (
        '<svg class="strip" viewBox="0 0 320 20" role="img" aria-label="sizes of effects">'
        f'<path class="axis" d="M8 10H312"/><path class="limit" d="M{at(SEEN):.1f} 0V20"/>'
        f"{dots}</svg>"
    )


def _calibration(results: Results) -> str:
    points = results["calibration"][first(results)]
    if not points:
        return ""
    nominal = np.array([0.0, *(p["nominal"] for p in points)])
    covered = np.array([0.0, *(p["covered"] for p in points)])
    series = [Series("before", nominal, nominal), Series("after", nominal, covered, "beads")]
    axes = Axes("share that intervals should hold", "share they hold", "Calibration of intervals")
    keys = '<p><span class="key before">as it should</span><span class="key after">is</span></p>'
    words = (
        "Share of intervals that hold the truth, for intervals of every size, scaled from those of "
        "95 % as for normal errors; rightly named effects only."
    )
    body = f'<div class="grid"><figure>{chart(series, axes)}{keys}</figure></div>'
    return section("Calibration", words, body)


def _sealed(results: Results) -> str:
    wall = {
        "landlock": "the kernel (Landlock) and Python's audit hook",
        "audit": "Python's audit hook; this system has no Landlock",
    }[results["guard"]]
    said = (
        f"Answers were sealed before the first diagnosis, and guarded by {wall}. manifest.json "
        "has hashes of all cases and commitments to the answers, ledger.json those of all "
        "diagnoses, answers.json the opened answers with their salts and the key."
    )
    changed = "<p>The code was changed while the trial ran.</p>" * bool(results["code_changed"])
    code = f"<p>Code: SHA-256 <code>{html.escape(results['code'])}</code></p>"
    return section("Seals", said, code + changed)
