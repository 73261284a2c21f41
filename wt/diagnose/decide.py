"""The search: effects are added while they earn it, and dropped again if they stop doing so."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose.addition import EQUIVALENT_NATS, Accepted, addition
from wt.diagnose.assessed import Assessed, Hypothesis, without
from wt.diagnose.hypotheses import dof_of
from wt.diagnose.objective import Objective
from wt.diagnose.refine import refine
from wt.diagnose.result import Considered
from wt.diagnose.screen import Screen
from wt.diagnose.worth import MIN_NATS, earns, exhausted, worth
from wt.physics.planted import Key

Report = Callable[[str, float], None]
"""Called with (what is being done, share of the whole 0…1)."""

MOST_EFFECTS = 16
FEW = 3
"""So many effects that joined in one round are all looked for again."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the search found.

    Attributes:
        accepted: effects in the order they were added.
        considered: every hypothesis that was screened high or replayed.
    """

    accepted: tuple[Accepted, ...]
    considered: tuple[Considered, ...]


def search(
    screen: Screen,
    objective: Objective,
    report: Report | None = None,
    start: Sequence[Accepted] = (),
    banned: Container[Key] = frozenset(),
) -> Outcome:
    """Add effects while they earn their place.

    Args:
        screen: the force residual.
        objective: the replays.
        report: called with (what is being done, share of the whole 0…1).
        start: effects to start from.
        banned: effects at places that have been found to predict nothing.
    """
    accepted = list(start)
    considered: list[Considered] = []
    now = objective.reference(tuple(a.planted for a in accepted))
    while len(accepted) < MOST_EFFECTS and not exhausted(objective, now):
        if report:
            what = f"looking for effect {len(accepted) + 1}"
            report(what, 0.15 + 0.55 * len(accepted) / MOST_EFFECTS)
        room = MOST_EFFECTS - len(accepted)
        before = {a.planted.key for a in accepted}
        found = addition(screen, objective, now, accepted, considered, room, banned)
        if not found:
            break
        accepted += found
        now = _fitted(objective, (*now.hypothesis, *(a.planted for a in found)))
        accepted, now = _prune(objective, accepted, now)
        accepted, now = _reconsidered(screen, objective, accepted, now, considered, banned, found)
        if {a.planted.key for a in accepted} <= before:
            break  # what was added lasted no longer than its round
    final = [
        replace(a, planted=planted) for a, planted in zip(accepted, now.hypothesis, strict=True)
    ]
    return Outcome(tuple(final), tuple(considered))


def _fitted(objective: Objective, hypothesis: Hypothesis) -> Assessed:
    """All effects of a hypothesis refined together, with the objective linear around them."""
    now = objective.reference(hypothesis)
    (now,) = refine(objective, [now.hypothesis], [range(len(hypothesis))], iterations=3)
    return objective.reference(now.hypothesis, now.nuisance)


def _reconsidered(
    screen: Screen,
    objective: Objective,
    accepted: list[Accepted],
    now: Assessed,
    considered: list[Considered],
    banned: Container[Key],
    found: Sequence[Accepted],
) -> tuple[list[Accepted], Assessed]:
    """Each of some effects that joined together is looked for again beside the others.

    Two at one joint were chosen by the force residual, and few others were replayed in their
    place. Of many that joined only such pairs are looked for again: each costs a whole round.
    """
    dofs = [dof_of(screen, a.planted.at) for a in found]
    again = [
        a for a, dof in zip(found, dofs, strict=True) if len(found) <= FEW or dofs.count(dof) > 1
    ]
    for key in [a.planted.key for a in again] if len(found) > 1 else ():
        index = next((i for i, a in enumerate(accepted) if a.planted.key == key), None)
        if index is None:  # replaced or pruned already
            continue
        rest = [a for i, a in enumerate(accepted) if i != index]
        base = _fitted(objective, without(now.hypothesis, index))
        kept = [replace(a, planted=p) for a, p in zip(rest, base.hypothesis, strict=True)]
        others = addition(screen, objective, base, kept, considered, 1, banned)
        names = {a.planted.key for a in accepted}
        if any(a.planted.key not in names for a in others):
            other = _fitted(objective, (*base.hypothesis, others[0].planted))
            if worth(objective, other, now) > EQUIVALENT_NATS:
                accepted, now = [*rest, *others], other
                continue
        now = objective.reference(now.hypothesis, now.nuisance)
    return accepted, now


def _prune(
    objective: Objective, accepted: list[Accepted], now: Assessed
) -> tuple[list[Accepted], Assessed]:
    """Drop effects that the later ones made superfluous."""
    while len(accepted) > 1:
        lesser = [without(now.hypothesis, i) for i in range(len(accepted))]
        fits = refine(objective, lesser, [range(len(accepted) - 1)] * len(lesser), iterations=2)
        losses = [worth(objective, now, fit) for fit in fits]
        weakest = int(np.argmin(losses))
        if losses[weakest] > MIN_NATS and earns(objective, now, fits[weakest]):
            break
        accepted = [a for i, a in enumerate(accepted) if i != weakest]
        now = objective.reference(fits[weakest].hypothesis, fits[weakest].nuisance)
    return accepted, now
