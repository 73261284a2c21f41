"""The report of ``wt reproduce``: ``report.md``, ``report.html`` and every figure as a PNG.

The page is one file: its pictures are in it, and it needs nothing but a browser.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from wt.reproduce.exhibit import Exhibit, Grid, Section
from wt.show.files import write_together
from wt.show.page import escaped, items, section, table, template
from wt.show.text import markdown_table, terminal_table

REPORT, PAGE = "report.md", "report.html"
TITLE = "World Translation: the paper's evaluation, and beyond it"
_DPI = 150
_STYLE = (
    "<style>figure img { width: 100%; height: auto; background: #fff; border-radius: 6px } "
    "caption { caption-side: bottom; text-align: left; padding-top: 6px }</style>"
)


@dataclass(frozen=True)
class Entry:
    """One exhibit in the report.

    Attributes:
        exhibit: which.
        section: what it says; None where it was not run.
        why_not: why it was not run.
    """

    exhibit: Exhibit
    section: Section | None
    why_not: str = ""


def tell(entry: Entry, console: Console) -> None:
    """Print an exhibit's tables and lines, with all columns also where that is wider than it."""
    if entry.section is None:
        return
    for grid in entry.section.grids:
        head = [escape(name) for name in grid.head]  # units are no markup
        console.print(terminal_table(head, grid.rows, entry.exhibit.title), crop=False)
    for line in entry.section.differences:
        console.print(f"- {line}", highlight=False, markup=False)


def write(folder: Path, entries: Sequence[Entry], about: str) -> Path:
    """Write the report.

    Args:
        folder: where it goes; the runs lie below it.
        entries: the exhibits in order.
        about: one sentence on how the numbers were made.

    Returns:
        The path of the page.
    """
    pictures: dict[str, bytes] = {}
    for entry in entries:
        for name, figure in (entry.section.figures if entry.section else {}).items():
            png = BytesIO()
            figure.savefig(png, format="png", dpi=_DPI)
            pictures[f"{name}.png"] = png.getvalue()
    contents: dict[str, str | bytes] = {
        **pictures,
        REPORT: _markdown(entries, about),
        PAGE: _page(entries, about, pictures),
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_together(folder, contents)
    return folder / PAGE


def _markdown(entries: Sequence[Entry], about: str) -> str:
    lines = [f"# {TITLE}", "", about, ""]
    for entry in entries:
        lines += [f"## {entry.exhibit.title}", ""]
        if entry.section is None:
            lines += [f"Not run: {entry.why_not}.", ""]
            continue
        lines += [entry.section.text, ""]
        for grid in entry.section.grids:
            lines += [*markdown_table(grid.head, grid.rows), ""]
            lines += [grid.caption, ""] if grid.caption else []
        for name in entry.section.figures:
            lines += [f"![{entry.exhibit.title}]({name}.png)", ""]
        lines += [*(f"- {line}" for line in entry.section.differences), ""]
    return "\n".join(lines).rstrip() + "\n"


def _page(entries: Sequence[Entry], about: str, pictures: Mapping[str, bytes]) -> str:
    parts = [
        f'<header><h1>{escaped(about)}</h1><ul class="lead"><li>{escaped(TITLE)}</li></ul></header>'
    ]
    for entry in entries:
        if entry.section is None:
            parts.append(section(entry.exhibit.title, f"Not run: {entry.why_not}.", ""))
            continue
        body = "".join(_grid(grid) for grid in entry.section.grids)
        body += "".join(
            _picture(entry.exhibit.title, pictures[f"{name}.png"]) for name in entry.section.figures
        )
        if entry.section.differences:
            body += items(entry.section.differences)
        parts.append(section(entry.exhibit.title, entry.section.text, body))
    body = _STYLE + "\n".join(parts)
    return template().substitute(title=TITLE, shades="", body=body)


def _grid(grid: Grid) -> str:
    head = [grid.head[0], *(f"#{name}" for name in grid.head[1:])]
    rows = [
        "<tr>" + "".join(
            f'<td class="{"n" if i else "name"}">{escaped(cell)}</td>' for i, cell in enumerate(row)
        ) + "</tr>"
        for row in grid.rows
    ]  # fmt: skip
    note = f'<p class="note">{escaped(grid.caption)}</p>' if grid.caption else ""
    return table(head, rows) + note


def _picture(title: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    return f'<figure><img alt="{escaped(title)}" src="data:image/png;base64,{data}"></figure>'
