"""Log of every decision: what was considered as missing physics, and why it stayed or went."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from wt.diagnose.result import Decision, Stage
from wt.physics.planted import Planted


class DecisionLog:
    """Grows as a diagnosis goes on; every stage appends, in the order of time."""

    def __init__(self) -> None:
        """Begin an empty log."""
        self._decisions: list[Decision] = []

    def __iter__(self) -> Iterator[Decision]:
        """All decisions so far, in the order of time."""
        return iter(self._decisions)

    def trying(self, hypotheses: Sequence[Planted], leading: Planted | None = None) -> None:
        """Called before hypotheses are replayed, and when one leads: for those who watch.

        Args:
            hypotheses: what may join, each beside what has.
            leading: the one that explains most by the first replays.
        """

    def add(
        self,
        planted: Planted,
        stage: Stage,
        kept: bool,
        statistic: float,
        threshold: float,
        reason: str,
    ) -> None:
        """Append a decision on an effect at a place.

        Args:
            planted: the effect and its place.
            stage: where it was decided.
            kept: whether it stayed.
            statistic: figure that decided, in the unit of the stage (see :data:`Stage`).
            threshold: figure that it was compared with.
            reason: one clause for people.
        """
        number = statistic if math.isfinite(statistic) else None  # JSON has no infinity
        self._decisions.append(
            Decision(planted.effect.id, planted.at, stage, kept, number, threshold, reason)
        )
