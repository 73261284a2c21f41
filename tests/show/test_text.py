"""Tables in a terminal."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from wt.show.text import duration, terminal_table

HEAD = ["MSE at horizon", "1", "5", "10", "20", "30", "40", "50"]
ROW = ["WorldTranslationPlus", "0.00496 ± 0.0002", "0.043 ± 0.001", "0.13 ± 0.006",
       "0.513 ± 0.01", "0.898 ± 0.03", "1.04 ± 0.04", "1.44 ± 0.04"]  # fmt: skip


def printed(width: int) -> str:
    out = io.StringIO()
    Console(file=out, width=width).print(terminal_table(HEAD, [ROW], "Rollouts"))
    return out.getvalue()


def test_a_narrow_terminal_wraps_cells_and_breaks_no_number() -> None:
    text = printed(80)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    for cell in ROW:
        assert all(word in text.split() for word in cell.split())


def test_a_wide_terminal_keeps_each_row_in_one_line() -> None:
    (line,) = [line for line in printed(160).splitlines() if ROW[0] in line]
    assert all(cell in line for cell in ROW)


def test_markup_takes_no_room() -> None:
    out = io.StringIO()
    table = terminal_table(["method", *HEAD[1:]], [["a", "[bold]0.0069[/bold]", *ROW[2:]]])
    Console(file=out, width=70).print(table)
    assert "…" not in out.getvalue()
    assert all(word in out.getvalue() for word in ("0.0069", "1.44", "0.04"))


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.2, "5 s"), (12.0, "10 s"), (99.0, "100 s"), (101.0, "2 min"), (5900.0, "98 min"),
     (7000.0, "1.9 h")],
)  # fmt: skip
def test_a_time_is_said_roughly(seconds: float, said: str) -> None:
    assert duration(seconds) == said
