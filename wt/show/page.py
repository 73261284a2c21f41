"""Pieces of the report's page: escaped text, sections, tables and bars."""

from __future__ import annotations

import html
import itertools
import re
from collections.abc import Sequence
from importlib import resources
from string import Template

from wt.show.text import tied


def style() -> str:
    """The style sheet of all pages, with ``$shades`` where a robot's colours go."""
    return _beside("page.css")


def template() -> Template:
    """The page around a report: styles, and ``$name`` where its parts go."""
    return Template(_beside("page.html").replace("$style", style()))


def _beside(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def escaped(said: str) -> str:
    """Escaped, with figures tied to their units."""
    return html.escape(tied(said))


def section(title: str, said: str, body: str) -> str:
    """A part of the page under a heading."""
    intro = f'<p class="soft">{escaped(said)}</p>' if said else ""
    return f"<section><h2>{escaped(title)}</h2>{intro}{body}</section>"


def table(head: Sequence[str], rows: Sequence[str], css: str = "") -> str:
    """A table of rows in HTML; a heading that begins with # is of a column of numbers.

    On a narrow page every row is a card, whose cells say which column they are of; empty ones are
    left out.

    Args:
        head: headings of the columns.
        rows: in HTML.
        css: a class; ``heat`` is of many narrow columns, whose headings stand upright.
    """
    cells = "".join(
        f'<th scope="col" class="n">{escaped(h[1:])}</th>'
        if h.startswith("#")
        else f'<th scope="col">{escaped(h)}</th>'
        for h in head
    )
    labels = [escaped(h.removeprefix("#")) for h in head]
    body = "".join(_labelled(row, labels) for row in rows)
    content = f"<thead><tr>{cells}</tr></thead><tbody>{body}</tbody>"
    kind = f' class="{css}"' if css else ""
    return f'<div class="scroll"><table{kind}>{content}</table></div>'


def _labelled(row: str, labels: Sequence[str]) -> str:
    """A row whose cells carry the heading of their column."""
    label = itertools.chain(labels, itertools.repeat(""))
    return re.sub("<td", lambda _: f'<td data-label="{next(label)}"', row)


def items(sentences: Sequence[str]) -> str:
    """A list of sentences."""
    return f'<ul class="next">{"".join(f"<li>{escaped(s)}</li>" for s in sentences)}</ul>'


def bar(css: str, share: float) -> str:
    """A bar as long as a share, 0…1."""
    return f'<span class="bar {css}" style="width:{100 * min(max(share, 0.0), 1.0):.1f}%"></span>'
