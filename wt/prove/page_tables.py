"""The tables of a trial's page: real machines, confusions, and every case."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

from wt.prove.case_result import CaseResult
from wt.prove.contenders import OURS
from wt.prove.real import REAL
from wt.prove.results import Results, title
from wt.prove.score import Finding
from wt.prove.tally import NOTHING
from wt.show.page import escaped, section, table


def first(results: Results) -> str:
    """The contender that is shown: ours, if it competes."""
    return OURS if OURS in results["scores"] else next(iter(results["scores"]))


def machines(results: Results) -> str:
    """Held-out errors on real machines."""
    contenders = list(results["scores"])
    rows = []
    for machine in results["machines"]:
        published = machine["published_rmse"]
        errors = [machine["before_rmse"], *(machine["after_rmse"][who] for who in contenders)]
        cells = "".join(
            f'<td class="n">{_milli(error)}</td>'
            for error in (published, *errors, machine["repeat_rmse"])
        )
        ours = machine["after_rmse"][contenders[0]]
        behind = published is not None and (ours is None or ours > published)
        said = escaped(_figures(machine["findings"][contenders[0]]))
        minutes = f"{machine['seconds'][contenders[0]] / 60.0:.1f}"
        rows.append(
            f'<tr class="{"bad" if behind else ""}"><td class="name">{escaped(machine["name"])}'
            f"</td>{cells}<td>{said}</td><td>{escaped(machine['known'])}</td>"
            f'<td class="n">{minutes}</td></tr>'
        )
    if not rows:
        return ""
    head = (
        "", "#published", "#given", *(f"#{title(who)}" for who in contenders), "#floor", "said",
        "known of it", "#min",
    )  # fmt: skip
    words = (
        "Errors on held-out motions [mrad, mm on slides], each model as MJCF in plain MuJoCo. "
        "Published: what its laboratory fitted, with all motions at hand; orange: ours is worse. "
        "Floor: deviation of one run from the mean of two with the same commands, where a motion "
        "was repeated. Minutes: of our diagnosis."
    )
    return section("Real machines", words, table(head, rows))


def _milli(error: float | None) -> str:
    return "–" if error is None else f"{1e3 * error:.1f}"


def _listed(findings: Sequence[Finding]) -> str:
    return ", ".join(f"{f['effect']} at {f['at']['name']}" for f in findings) or NOTHING


def _figures(findings: Sequence[Finding]) -> str:
    """Findings with their parameters and intervals."""
    said = []
    for f in findings:
        figures = ", ".join(
            f"{name} {p['value']:.3g} [{p['ci95'][0]:.3g}, {p['ci95'][1]:.3g}] {p['unit']}"
            for name, p in f.get("parameters", {}).items()
            if not isinstance(p["value"], list)
        )
        said.append(f"{f['effect']} at {f['at']['name']}" + (f": {figures}" if figures else ""))
    return "; ".join(said) or NOTHING


def confusion(results: Results) -> str:
    """Hidden effects against claims."""
    counts: Mapping[str, Mapping[str, int]] = results["confusion"][first(results)]
    if not counts:
        return ""
    hidden = sorted(counts, key=lambda law: (law == NOTHING, law))
    said = sorted({s for inner in counts.values() for s in inner}, key=lambda s: (s == NOTHING, s))
    rows = []
    for law in hidden:
        total = sum(counts[law].values())
        right = "unknown" if law.startswith("outsider.") else law
        cells = "".join(_heat(counts[law].get(s, 0), total, s == right) for s in said)
        rows.append(f'<tr><td class="name"><code>{html.escape(law)}</code></td>{cells}</tr>')
    words = "Rows: hidden effects. Columns: claims at their places. Outlined: right."
    return section("Confusions", words, table(("", *said), rows, "heat"))


def _heat(count: int, total: int, right: bool) -> str:
    css = ' class="same"' if right else ""
    if not count:
        return f"<td{css}></td>"
    color = "after" if right else "before"
    share = round(10 + 35 * count / total)  # what is written on it stays readable
    style = f"background: color-mix(in oklab, var(--{color}) {share}%, transparent)"
    return f'<td{css} style="{style}">{count}</td>'


def cases(results: Results) -> str:
    """All cases, with links to our reports."""
    who = first(results)
    rows = [_case(CaseResult.from_json(case), who) for case in results["cases"]]
    head = ("case", "hidden", "said", "outcome", "#held-out error left")
    return f"<details><summary>All {len(rows)} cases</summary>{table(head, rows)}</details>"


def _case(case: CaseResult, who: str) -> str:
    """One case as a row of the table."""
    result = case.contenders[who]
    hidden = ", ".join(f"{effect.law} at {effect.name}" for effect in case.truth) or NOTHING
    if case.kind == REAL:
        hidden = "?"
    name = html.escape(case.name)
    if who == OURS and not result.error:
        name = f'<a href="diagnoses/{who}/{case.id}/report.html">{name}</a>'
    left = case.after_rmse[who] / case.before_rmse if case.before_rmse else math.nan
    css, word = _verdict(case, who)
    return (
        f"<tr><td>{name}</td><td>{escaped(hidden)}</td>"
        f"<td>{escaped(result.error or _listed(result.findings))}</td>"
        f'<td class="{css}">{word}</td><td class="n">{100 * left:.0f} %</td></tr>'
    )


def _verdict(case: CaseResult, who: str) -> tuple[str, str]:
    """CSS class and words for the marks of a case."""
    marks = case.marks(who)
    if case.kind == REAL:
        return "", ""
    if not case.truth:
        return ("bad", "false alarm") if case.contenders[who].false_alarm else ("ok", "silent")
    if marks.effect:
        return ("ok", "right") if not marks.false_claims else ("", "right, and more")
    return ("", "place only") if marks.location else ("bad", "missed")
