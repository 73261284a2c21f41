"""Numbers and tables as text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Literal

from rich import box
from rich.table import Table
from rich.text import Text

NBSP = "\N{NO-BREAK SPACE}"
_BEFORE_UNIT = re.compile(
    r"(?<=[0-9⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:%|°|[mµ]?rad|[mµ]?m|[mµ]?s|N|kg|Hz|nats)(?!\w))"
)


def tied(text: str) -> str:
    """The text with no-break spaces between figures and their units."""
    return _BEFORE_UNIT.sub(NBSP, text)


def short(value: float) -> str:
    """Three significant digits."""
    return f"{value:.3g}" if math.isfinite(value) else "–"


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A Markdown table: first column left, the others right."""
    align = ["---"] + ["---:"] * (len(head) - 1)
    return ["| " + " | ".join(cells) + " |" for cells in (head, align, *rows)]


def terminal_table(head: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> Table:
    """The same for a terminal; where it is too narrow, cells take two lines and lose nothing."""
    table = Table(title=title or None, box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), pad_edge=False)
    for i, name in enumerate(head):
        justify: Literal["left", "right"] = "right" if i else "left"
        cells = (Text.from_markup(cell).plain for cell in (name, *(row[i] for row in rows)))
        words = (word for cell in cells for word in cell.split())
        longest = max(map(len, words), default=0)  # a number is never broken
        table.add_column(name, justify=justify, no_wrap=not i, min_width=longest)
    for row in rows:
        table.add_row(*row)
    return table


def duration(seconds: float) -> str:
    """A time in words, as roughly as such times are foretold."""
    if seconds < 100.0:
        return f"{max(round(seconds / 5.0) * 5, 5)} s"
    minutes = seconds / 60.0
    return f"{minutes:.0f} min" if minutes < 100.0 else f"{minutes / 60.0:.1f} h"
