"""The report's part on a trained translation: when something hidden acted, and what it misses."""

from __future__ import annotations

import numpy as np

from wt.diagnose import words
from wt.diagnose.evidence import Translated
from wt.diagnose.page import bar, items, section, table, text
from wt.diagnose.result import Diagnosis
from wt.diagnose.translated import STANDS_OUT, sentences
from wt.show.charts import Axes, Series, chart

_MOST = 4
"""Recordings that are drawn."""


def translation(d: Diagnosis) -> str:
    """The section; empty if no translation was given."""
    found = d.translated
    if found is None:
        return ""
    said = (
        f"{found.name} saw every control step: the model's answer from the recorded state, "
        "translated, beside what the machine did."
    )
    rows = [_row(found, kind) for kind in dict.fromkeys(_kind(c.name) for c in found.channels)]
    errors = table(("channels", "#model's answer", "#translated", "#left", ""), rows)
    charts = "".join(_chart(d, found, i) for i in range(min(len(found.distances), _MOST)))
    return section(
        "What a trained translation says",
        said,
        f'{items(sentences(found))}{errors}<div class="grid">{charts}</div>',
    )


def _kind(name: str) -> str:
    return name.partition("/")[0]


def _row(found: Translated, kind: str) -> str:
    """Root mean squares over the channels of one kind."""
    mine = [c for c in found.channels if _kind(c.name) == kind]
    before, after = (
        float(np.sqrt(np.mean([getattr(c, which) ** 2 for c in mine])))
        for which in ("before", "after")
    )
    factor, unit = words.scaled(max(before, after), mine[0].unit)
    largest = max(before, after, 1e-30)
    share = (after / max(before, 1e-30)) ** 2
    cells = [f"{words.number(x * factor)} {unit}" for x in (before, after)]
    cells.append(f"{words.percent(share)} %")
    return (
        f'<tr><td class="name">{text(kind)}</td>'
        + "".join(f'<td class="n">{text(cell)}</td>' for cell in cells)
        + f'<td class="bars">{bar("before", before / largest)}{bar("after", after / largest)}</td>'
        + "</tr>"
    )


def _chart(d: Diagnosis, found: Translated, index: int) -> str:
    distance = found.distances[index]
    name = words.short_name(d, distance.name)
    spans = tuple((e.start, e.end) for e in found.events if e.recording == distance.name)
    axes = Axes(
        x="time [s]",
        y="distance of features [usual ones]",
        alt=f"How far features are from the expected ones, over time in {name}",
        spans=spans,
    )
    shown = "; shaded where it stands out" if spans else f", below {STANDS_OUT:g} on average"
    drawn = chart([Series("before", distance.t, distance.size)], axes)
    caption = text(f"{name}: distance from the feature that translation expects{shown}.")
    return f"<figure>{drawn}<figcaption>{caption}</figcaption></figure>"
