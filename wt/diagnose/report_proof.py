"""The report's proof: errors on held-out data, of the joints and of all else the robot reports."""

from __future__ import annotations

from wt.diagnose import figures, words
from wt.diagnose.page import bar, items, section, table, text
from wt.diagnose.result import Diagnosis, Error


def proof(d: Diagnosis) -> str:
    """The section."""
    p = d.proof
    largest = max([*(e.before for e in p.joints.values()), p.holdout.before, 1e-30])
    rows = [_error_row(d, "all joints", p.holdout, largest, "best")]
    rows += [_error_row(d, name, error, largest, "") for name, error in p.joints.items()]
    _, unit = words.scaled(largest, d.unit)
    errors = ("#before", "#after", "#noise") if d.findings else ("#error", "#noise")
    left_head = ("#left",) if d.findings else ()
    head = ("joint", *(f"{e} [{unit}]" for e in errors), *left_head, "")
    split = f" Held out: {p.split}." if p.split else ""
    said = (
        f"Root mean square errors of open-loop replays on data that nothing was fitted to.{split}"
    )
    ahead = figures.horizon(d)
    parts = [
        f"<p>{figures.BEFORE_AFTER}</p>" if d.findings else "",
        table(head, rows),
        _measured(d),
        f"<h3>Left over</h3>{items(p.left_over)}" if p.left_over else "",
        f'<div class="grid">{ahead}</div>' if ahead else "",
    ]
    return section("Proof" if d.findings else "Errors", said, "".join(parts))


def _error_row(d: Diagnosis, name: str, e: Error, largest: float, css: str) -> str:
    factor, _ = words.scaled(largest, d.unit)
    cells = [words.number(e.before * factor), words.number(e.noise_floor * factor, 2)]
    bars = bar("before", e.before / largest)
    if d.findings:
        cells.insert(1, words.error(e.after * factor, e.noise_floor * factor))
        cells.append(f"{words.percent(e.ratio)} %")
        bars += bar("after", e.after / largest)
    return (
        f'<tr class="{css}"><td class="name">{text(name)}</td>'
        + "".join(f'<td class="n">{text(c)}</td>' for c in cells)
        + f'<td class="bars">{bars}</td></tr>'
    )


def _measured(d: Diagnosis) -> str:
    """Errors at further sensors; empty if nothing else was recorded."""
    rows = []
    for s in d.measured.sensors:
        largest = max(s.before, s.after or 0.0, 1e-30)
        factor, unit = words.scaled(largest, s.unit)
        cells = [f"{words.number(s.before * factor)} {unit}"]
        bars = bar("before", s.before / largest)
        if d.findings:
            left = ["–", "–"]
            if s.after is not None:
                share = s.after / max(s.before, 1e-30)
                left = [f"{words.number(s.after * factor)} {unit}", f"{words.percent(share)} %"]
                bars += bar("after", s.after / largest)
            cells += left
        rows.append(
            f'<tr><td class="name">{text(s.name)}</td>'
            + "".join(f'<td class="n">{text(c)}</td>' for c in cells)
            + f'<td class="bars">{bars}</td></tr>'
        )
    if not rows:
        return ""
    said = "The same replays, at the other sensors that were recorded; nothing was fitted to them."
    if any(s.after is None for s in d.measured.sensors):
        said += " –: forces that the replay of the patched model does not tell."
    errors = ("#before", "#after", "#left") if d.findings else ("#error",)
    shown = table(("sensor", *errors, ""), rows)
    return f'<h3>What else the robot reports</h3><p class="soft">{text(said)}</p>{shown}'
