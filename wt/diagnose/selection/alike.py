"""Laws that joints have in common: a machine's drives are of one kind, and so is what they lack.

Where a model is wrong about a servo, it is wrong about the same in all of its kind. Joint by joint
each takes something else that stands in for two laws there, and errs by what stands in at the next:
all joints that err are given the same laws at once, one kind of law after another, each joint with
a parameter of its own. Each kind is fitted beside those that are there, and the best one joins.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import jacobian, refine
from wt.diagnose.selection.smooth_laws import Laws, LawSlopes, Theta, laws_of, solved, stepped
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Shape
from wt.physics.planted import Key, Planted

_STEPS = 8
"""Most steps in which a kind is fitted beside others: gains and friction go far together."""


def alike(
    objective: Objective,
    now: Assessed,
    dofs: Collection[int],
    banned: Container[Key] = frozenset(),
) -> list[tuple[Planted, Shape]]:
    """The same smooth laws at several joints, as far as each needs them.

    Args:
        objective: the replays.
        now: the present hypothesis.
        dofs: degrees of freedom of the joints.
        banned: what must not join.

    Returns:
        Laws, with the shapes of their signatures, to take the place of all that is found at these
        joints alone; whether they are better, replays of them, refined, have to say.
    """
    laws = laws_of(objective, now, dofs, banned)
    kinds = dict[str, list[int]]()
    for i, law in enumerate(laws.each):
        if not law.of_sensor:
            kinds.setdefault(law.forms[0][0].id, []).append(i)
    at = _begun(laws)
    while kinds:
        ways = dict(zip(kinds, _joined(laws, at, kinds.values()), strict=True))
        best = max(ways, key=lambda kind: ways[kind].merit)
        (after,) = _fitted(laws, [(ways[best].kept, ways[best].theta)])
        if not after.merit > at.merit + THRESHOLDS.min_nats:
            break
        at = after
        del kinds[best]
    kept, theta, _ = _needed(laws, at, _slopes(laws, at), at.kept)
    return [laws.each[i].planted(float(theta[i])) for i in kept]


class _At(NamedTuple):
    """Some of the laws, replayed.

    Attributes:
        kept: which.
        theta: parameters of all, those of the others nothing.
        fit: with what is found elsewhere.
        merit: of that.
    """

    kept: list[int]
    theta: Theta
    fit: Assessed
    merit: float


def _replayed(laws: Laws, kept: list[int], theta: Theta, fit: Assessed) -> _At:
    return _At(kept, theta, fit, laws.merit_of(fit, kept, fit.loglik, theta))


def _begun(laws: Laws) -> _At:
    """What is found elsewhere, alone."""
    (fit,) = laws.objective.evaluate([laws.others])
    return _replayed(laws, [], laws.nothing, fit)


def _slopes(laws: Laws, at: _At) -> LawSlopes:
    """Derivatives of the replays in all of the laws."""
    (all_there,) = laws.objective.evaluate([laws.hypothesis(at.theta, range(len(laws.each)))])
    (slope,) = jacobian(laws.objective, [all_there], [laws.parts])
    return slope


def _joined(laws: Laws, at: _At, further: Iterable[Sequence[int]]) -> list[_At]:
    """With each of some further kinds, fitted, at the joints that need it."""
    everywhere, sets = _slopes(laws, at), [sorted([*at.kept, *more]) for more in further]
    starts = [(kept, stepped(laws, at.fit, everywhere, at.theta, kept)[1]) for kept in sets]
    fits, parts = _fitted(laws, starts), [laws.some(kept).parts for kept in sets]
    slopes = jacobian(laws.objective, [fit.fit for fit in fits], parts)
    return [
        _lessened(laws, fit, slope, at.kept) if np.isfinite(fit.merit) else fit
        for fit, slope in zip(fits, slopes, strict=True)
    ]


def _lessened(laws: Laws, fit: _At, slope: LawSlopes, stay: Collection[int]) -> _At:
    """A fit without those of its laws that say too little, but for some that stay."""
    some, places = laws.some(fit.kept), list(range(len(fit.kept)))
    asked = [place for place in places if fit.kept[place] not in stay]
    here = fit._replace(kept=places, theta=fit.theta[fit.kept])
    kept, theta, merit = _needed(some, here, slope, asked)
    changed = fit.theta.copy()
    changed[fit.kept] = theta
    return _At([fit.kept[place] for place in kept], changed, fit.fit, merit)


def _fitted(laws: Laws, starts: Sequence[tuple[list[int], Theta]]) -> list[_At]:
    """Each of some sets of laws, refined from such parameters."""
    hypotheses = [laws.hypothesis(theta, kept) for kept, theta in starts]
    parts = [laws.some(kept).parts for kept, _ in starts]
    refined, fits = refine(laws.objective, hypotheses, parts, iterations=_STEPS), []
    for (kept, _), fit in zip(starts, refined, strict=True):
        theta = laws.nothing
        theta[kept] = [float(p.theta[0]) for p in fit.hypothesis[len(laws.others) :]]
        fits.append(_replayed(laws, kept, theta, fit))
    return fits


def _needed(
    laws: Laws, at: _At, slope: LawSlopes, asked: Sequence[int]
) -> tuple[list[int], Theta, float]:
    """Laws without those of some that say too little at their joints, by the slopes.

    Returns:
        (the laws; parameters of all; merit).
    """
    kept, theta = at.kept, at.theta

    def merit_of(some: Sequence[int]) -> float:
        return laws.merit_of(at.fit, some, *solved(laws, at.fit, slope, at.theta, some))

    best = merit_of(kept)
    while left := [i for i in asked if i in kept]:
        less = {i: merit_of([k for k in kept if k != i]) for i in left}
        weakest = max(less, key=less.__getitem__)
        if less[weakest] < best:
            break
        kept, best = [k for k in kept if k != weakest], less[weakest]
        _, theta = solved(laws, at.fit, slope, at.theta, kept)
    return kept, theta, best
