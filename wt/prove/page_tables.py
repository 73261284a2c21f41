"""The tables of a trial's page: real machines, confusions, and every case."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from typing import Any

from wt.prove.contenders import OURS
from wt.prove.real import REAL
from wt.prove.results import Results, title
from wt.prove.tally import NOTHING
from wt.show.page import escaped, section, table


def first(results: Results) -> str:
    """Who is shown: ours, if it competes."""
    return OURS if OURS in results["scores"] else next(iter(results["scores"]))


def machines(results: Results) -> str:
    """Held-out errors on real machines."""
    everybody = list(results["scores"])
    rows = []
    for one in results["machines"]:
        errors = [one["before_rmse"], *(one["after_rmse"][who] for who in everybody)]
        cells = "".join(
            f'<td class="n">{_milli(error)}</td>' for error in (*errors, one["repeat_rmse"])
        )
        said = _listed(one["findings"][everybody[0]])
        name = escaped(one["name"])
        rows.append(f'<tr><td class="name">{name}</td>{cells}<td>{escaped(said)}</td></tr>')
    if not rows:
        return ""
    head = ("", "#given", *(f"#{title(who)}" for who in everybody), "#floor", "said")
    words = (
        "Errors on held-out motions [mrad], patched MJCF in plain MuJoCo. Floor: what one run is "
        "off by from the mean of two with the same commands, where a motion was repeated."
    )
    return section("Real machines", words, table(head, rows))


def _milli(error: float | None) -> str:
    return "–" if error is None else f"{1e3 * error:.1f}"


def _listed(findings: list[Mapping[str, Any]]) -> str:
    return ", ".join(f"{f['effect']} at {f['at']['name']}" for f in findings) or NOTHING


def confusion(results: Results) -> str:
    """What is hidden against what was said."""
    found: Mapping[str, Mapping[str, int]] = results["confusion"][first(results)]
    if not found:
        return ""
    hidden = sorted(found, key=lambda law: (law == NOTHING, law))
    said = sorted({s for inner in found.values() for s in inner}, key=lambda s: (s == NOTHING, s))
    head = '<th scope="col"></th>' + "".join(
        f'<th scope="col" class="up">{html.escape(s)}</th>' for s in said
    )
    rows = []
    for law in hidden:
        total = sum(found[law].values())
        right = "unknown" if law.startswith("outsider.") else law
        cells = "".join(_heat(found[law].get(s, 0), total, s == right) for s in said)
        rows.append(f'<tr><td class="name"><code>{html.escape(law)}</code></td>{cells}</tr>')
    body = (
        f'<div class="scroll"><table class="heat"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
    words = "Rows: what is hidden. Columns: what was said at that place. Outlined: right."
    return section("Confusions", words, body)


def _heat(count: int, total: int, right: bool) -> str:
    css = ' class="same"' if right else ""
    if not count:
        return f"<td{css}></td>"
    color = "after" if right else "before"
    share = round(15 + 60 * count / total)
    style = f"background: color-mix(in oklab, var(--{color}) {share}%, transparent)"
    return f'<td{css} style="{style}">{count}</td>'


def cases(results: Results) -> str:
    """All cases, with links to our reports."""
    who = first(results)
    rows = []
    for row in results["cases"]:
        said = row["said"][who]
        hidden = ", ".join(f"{t['law']} at {t['at']['name']}" for t in row["truth"]) or NOTHING
        if row["kind"] == REAL:
            hidden = "?"
        link = f"diagnoses/{who}/{row['id']}/report.html"
        name = html.escape(row["name"])
        shown = f'<a href="{link}">{name}</a>' if who == OURS and not said["error"] else name
        left = row["after_rmse"][who] / row["before_rmse"] if row["before_rmse"] else math.nan
        css, word = _verdict(row, who)
        rows.append(
            f"<tr><td>{shown}</td><td>{escaped(hidden)}</td>"
            f"<td>{escaped(said['error'] or _listed(said['findings']))}</td>"
            f'<td class="{css}">{word}</td><td class="n">{100 * left:.0f} %</td></tr>'
        )
    head = ("case", "hidden", "said", "", "#held-out error left")
    return f"<details><summary>All {len(rows)} cases</summary>{table(head, rows)}</details>"


def _verdict(row: Mapping[str, Any], who: str) -> tuple[str, str]:
    marks = row["said"][who]["marks"]
    if row["kind"] == REAL:
        return "", ""
    if not row["truth"]:
        wrong = marks["false_claims"] > 0 or bool(row["said"][who]["error"])
        return ("bad", "false alarm") if wrong else ("ok", "silent")
    if marks["effect"]:
        return ("ok", "right") if not marks["false_claims"] else ("", "right, and more")
    return ("", "place only") if marks["location"] else ("bad", "missed")
