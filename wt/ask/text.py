"""What was asked and answered, for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from wt.ask.loop import Round
from wt.ask.separation import Expected

if TYPE_CHECKING:
    from rich.console import Console

_EVEN = math.log(1.5)
"""Odds up to which nobody would say that something is told apart [nats]."""


def print_round(here: Round, number: int, console: Console) -> None:
    """Print what some recordings leave open, and what is done about it.

    Args:
        here: the round.
        number: of it, from 1 on.
        console: where to.
    """
    console.print(f"[bold]{number}[/bold]", end=" ")
    console.print(" ".join(here.claimed) or "No effect is claimed.", highlight=False)
    if here.rivals:
        console.print(f"  It may as well be: {', '.join(here.rivals)}.", highlight=False)
    if here.design is None:
        console.print(f"  Nothing more is asked: {here.reason}.", highlight=False)
        return
    for motion in here.design.motions:
        console.print(f"  next: {motion}", highlight=False)
    for line in expectations(here.design.expected, here.rivals):
        console.print(f"  {line}", highlight=False, style="dim")


def expectations(expected: Expected, rivals: Sequence[str]) -> list[str]:
    """What an experiment is expected to tell, a line for each rival of what is claimed."""
    told = [bool(expected.apart[0, i] > _EVEN) for i in range(1, len(rivals) + 1)]
    lines = [
        f"expected to tell {rival} from it by odds of {odds(expected.apart[0, i])}"
        if told[i - 1]
        else f"not expected to tell {rival} from it"
        for i, rival in enumerate(rivals, 1)
    ]
    if not any(told):
        information = f"{expected.information:.1f} nats of information"
        lines.append(f"expected to make intervals narrower: {information}")
    return lines


def odds(nats: float) -> str:
    """A log-likelihood ratio as odds."""
    if nats > 14.0:
        return "over a million to 1"
    return f"{float(f'{math.exp(nats):.1g}'):,.0f} to 1"
