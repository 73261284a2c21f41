"""Which effects of a hypothesis for all groups some group's recordings bear out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from wt.diagnose import again
from wt.diagnose.again import Recorded
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis

_FEW = 0.5
"""Share of the groups; what fewer of them found is asked of all."""


def borne_out(
    hypothesis: Hypothesis,
    found: Sequence[Hypothesis],
    groups: Sequence[Recorded],
    known: Hypothesis = (),
) -> tuple[Hypothesis, tuple[str, ...]]:
    """The effects that some group needs beside all others.

    A few seconds of one machine are now and then taken for something that no other machine has. In
    every group's estimates it would take a part of what the others mean, and its own would wander
    from session to session. So what few groups found must earn its place in one of them, as in a
    search, once all that other groups found stands beside it: a fault of one machine does, a
    lookalike does not. Those that the fewest found are asked first.

    Args:
        hypothesis: for all groups, of what each found.
        found: what was found in each group, those that were searched before among them.
        groups: recordings that were searched now.
        known: effects that the passport has: some group needed them whose recordings are not asked
            again, so that they stay.

    Returns:
        (the effects that stay; a note for each that was left out).
    """
    counts = Counter(p.key for one in found for p in one)
    stay = {p.key for p in known}
    doubtful = [p for p in hypothesis if p.key not in stay and counts[p.key] < _FEW * len(found)]
    kept, notes = hypothesis, list[str]()
    for planted in sorted(doubtful, key=lambda p: (counts[p.key], p.key)):
        if any(again.worth_of(of, kept, planted) > THRESHOLDS.min_nats for of in groups):
            continue
        kept = tuple(p for p in kept if p.key != planted.key)
        notes.append(
            f"{planted} was found in {counts[planted.key]} of {len(found)} groups, and none needs "
            "it beside what the others found: it is not estimated."
        )
    return kept, tuple(notes)
