"""Addition: the effects, if any, that join the present hypothesis in one round.

The best addition of all joins first. The best at other joints then get their chance on top of it: a
machine whose joints lack several things at once need not be screened anew for each.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Container, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wt.diagnose.likelihood.bic import earns, erring_joints, simplest, worth
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import Slopes, all_slopes, around_itself, refine, together
from wt.diagnose.residual.screen import Scored, Screen
from wt.diagnose.selection.candidates import Start, candidates, dof_of
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.memory import Memory
from wt.diagnose.selection.pairs import paired
from wt.diagnose.selection.round_log import log_replays, log_screened
from wt.diagnose.stop import StoppedError
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Shape, alternatives, effects, forms_of
from wt.physics.planted import Hypothesis, Key, Planted
from wt.types import Location

Named = tuple[str, Location]
"""Id of an effect, and a place."""

_STARTS, _PROMISING, _FINALISTS = 20, 8, 4
"""How many hypotheses of a round get one step, two more steps, and all effects refined."""
FAR, _NEAR = 1.0, 0.5
"""Finalists are settled where a tolerance is so many deviations from the model's, or from where it
is now, if they are worth so much of the best."""
_EACH = 2
"""… and so many at each joint get the two more steps, and their chance beside the best."""
_STARTED = 5
"""… and so many at each joint get a step at least."""
HOPELESS = 30.0
"""What is so many nats behind the effect whose place it would take is given up."""


class Incumbent(NamedTuple):
    """An effect that was found, and whose place others may take.

    Attributes:
        planted: the effect.
        loglik: of the hypothesis that has it, all effects refined.
    """

    planted: Planted
    loglik: float


@dataclass(frozen=True, eq=False)
class Accepted:
    """An effect that earned its place.

    Attributes:
        planted: effect, place, parameters.
        shape: of its signature, if it has one.
        rivals: what was replayed in its place and came close.
    """

    planted: Planted
    shape: Shape | None
    rivals: tuple[Planted, ...]


def addition(
    screen: Screen,
    objective: Objective,
    now: Assessed,
    accepted: Sequence[Accepted],
    log: DecisionLog,
    most: int,
    banned: Container[Key] = frozenset(),
    memory: Memory | None = None,
) -> list[Accepted]:
    """Effects to add to the present hypothesis, at most ``most``.

    Args:
        screen: the force residual.
        objective: the replays, linearised around the present hypothesis.
        now: the present hypothesis.
        accepted: its effects.
        log: grows by every decision.
        most: at most so many additions.
        banned: what must not join.
        memory: of earlier rounds.
    """
    memory = memory or Memory(objective)
    same = memory.same(now)
    narrowed = functools.partial(memory.narrowed, same=same)
    tried = _tried(screen, objective, now, accepted, log, banned, narrowed=narrowed)
    fits = list(tried.fits)
    with suppress(StoppedError):  # the best so far will do
        fresh = [f for f in fits if dof_of(screen, f.hypothesis[-1].at) not in same]
        pairs = [
            *paired(screen, objective, now, _known(accepted), tried.ranked, fresh),
            *memory.pairs(same),
        ]
        fits += _refined(objective, [(*now.hypothesis, *p) for p in pairs], now, 3)
        memory.note(now, tried.starts, fits, same)
        fits = _finished(objective, fits, now)
    best = _earning(objective, fits, now, log)
    if best is None:
        return []
    joined = _accepted(objective, best, fits, now, tried.shapes)
    with suppress(StoppedError):
        for more in _beside(screen, objective, best, fits, now) if len(joined) < most else ():
            joined += _accepted(objective, more.fit, more.fits, more.reference, tried.shapes)
            gain, planted = worth(objective, more.fit, more.reference), more.fit.hypothesis[-1]
            reason = f"beside {joined[0].planted}"
            log.add(planted, "joined", True, gain, THRESHOLDS.min_nats, reason)
    return joined[:most]


def replacement(
    screen: Screen,
    objective: Objective,
    now: Assessed,
    accepted: Sequence[Accepted],
    log: DecisionLog,
    banned: Container[Key],
    incumbent: Incumbent,
) -> Accepted | None:
    """The best effect in the place of one; None where nothing comes close to that.

    It acts on that one's degree of freedom, alone or with others; where that acts on several, it
    does too or looks like it.

    Args:
        screen: the force residual.
        objective: the replays, linearised around the present hypothesis.
        now: the present hypothesis, without that effect.
        accepted: its effects.
        log: grows by every decision.
        banned: what must not join.
        incumbent: the effect whose place it would take.
    """
    only = _alike(screen, incumbent.planted)
    tried = _tried(screen, objective, now, accepted, log, banned, only)
    fits, least = _rivals(objective, tried.fits, now, incumbent)
    with suppress(StoppedError):
        fits = _finished(objective, fits, now)
    fits = [f for f in fits if worth(objective, f, now) > least]
    best = _earning(objective, fits, now, log)
    return None if best is None else _accepted(objective, best, fits, now, tried.shapes)[-1]


class _Tried(NamedTuple):
    """What was replayed beside the present hypothesis.

    Attributes:
        ranked: what the force residual shows, best first.
        fits: of additions, refined the more the better they are.
        shapes: of their signatures.
    """

    ranked: list[Scored]
    starts: list[Start]
    fits: list[Assessed]
    shapes: dict[Key, Shape | None]


def _tried(
    screen: Screen,
    objective: Objective,
    now: Assessed,
    accepted: Sequence[Accepted],
    log: DecisionLog,
    banned: Container[Key],
    only: Container[Named] | None = None,
    narrowed: Callable[[list[Start]], list[Start]] = list,
) -> _Tried:
    """Replay what the screen shows, and what only replays show; any effect, or ``only`` some."""
    asked = functools.partial(_asked, banned, only)
    ranked = [s for s in screen.rank(_known(accepted), only) if asked(s.planted)]
    tried = narrowed([c for c in candidates(screen, ranked, objective, now) if asked(c[0])])
    log_screened(log, ranked, tried)
    log.trying([p for p, _ in tried])
    fits = _replayed(screen, objective, now, [p for p, _ in tried])
    if fits:
        log.trying([p for p, _ in tried], _by_worth(objective, fits, now)[0].hypothesis[-1])
    shapes = {s.planted.key: s.shape for s in ranked} | {p.key: shape for p, shape in tried}
    return _Tried(ranked, tried, fits, shapes)


def _known(accepted: Sequence[Accepted]) -> list[tuple[Planted, Shape | None]]:
    return [(a.planted, a.shape) for a in accepted]


def _earning(
    objective: Objective, fits: Sequence[Assessed], now: Assessed, log: DecisionLog
) -> Assessed | None:
    """The best fit, if it earns its place; what became of all of them is logged."""
    if not fits:
        return None
    best = simplest(objective, fits, now)
    earning = best if earns(objective, best, now) else None
    log_replays(log, objective, fits, now, earning)
    return earning


def _asked(banned: Container[Key], only: Container[Named] | None, planted: Planted) -> bool:
    """Tell whether an effect may join: it is not banned, and might be in another's place."""
    there = only is None or (planted.effect.id, planted.at) in only
    return there and planted.key not in banned


def _alike(screen: Screen, planted: Planted) -> set[Named]:
    """Effects at places that might be in the place of another, that one among them."""
    scene, there = screen.motion.scene, dof_of(screen, planted.at)
    alternative, acted_on = alternatives(planted.effect.id), scene.dofs_at(planted.at)
    return {
        (effect.id, at)
        for effect in effects().values()
        for at in effect.places(scene)
        if (there < 0 and effect.id in alternative)
        or (dof_of(screen, at) in (there, -1) and acted_on & scene.dofs_at(at))
    }


def _rivals(
    objective: Objective, fits: Sequence[Assessed], now: Assessed, incumbent: Incumbent
) -> tuple[list[Assessed], float]:
    """What comes close to an effect in its place, all refined as far.

    What is not too far behind for the others to adapt to it, as they do to that effect, or for
    refinement.

    Returns:
        (fits of others; what they are to be worth in the end not to be hopeless).
    """
    own = [f for f in fits if f.hypothesis[-1].key == incumbent.planted.key]
    others = [f for f in fits if f.hypothesis[-1].key != incumbent.planted.key]
    if not own:
        return others, -np.inf
    ahead = max(worth(objective, f, now) for f in own)
    adapted = incumbent.loglik - max(f.loglik for f in own)
    close = ahead - max(HOPELESS, adapted)
    return [f for f in others if worth(objective, f, now) >= close], ahead + adapted - HOPELESS


def _replayed(
    screen: Screen, objective: Objective, now: Assessed, additions: Sequence[Planted]
) -> list[Assessed]:
    """The additions, refined the more the better they are."""
    starts = _first_of_each(screen, objective, now, additions)
    fits = _by_worth(objective, _refined(objective, starts, now, 1), now)
    leading = _leading(screen, fits, _searched(objective, now), _PROMISING, _EACH)
    rest = [f for f in fits if f not in leading]
    # which form it has shows where its parameters are near: far off they decide alone
    every_form = [
        (*f.hypothesis[:-1], replace(f.hypothesis[-1], effect=form))
        for f in leading
        for form in forms_of(f.hypothesis[-1].effect)
    ]
    refined = _refined(objective, every_form, now, 2)
    return [*_best_of_each(refined), *rest]


def _finished(objective: Objective, fits: Sequence[Assessed], now: Assessed) -> list[Assessed]:
    """By falling worth, the best ones with all effects refined that what was added acts beside."""
    if not fits:
        return []
    fits = _by_worth(objective, fits, now)
    finalists = [f.hypothesis for f in fits[:_FINALISTS]]
    free = [together(objective, h, range(len(now.hypothesis), len(h))) for h in finalists]
    known = all_slopes(objective, now)
    refined = refine(objective, finalists, free, iterations=4, known=known)
    leader, *others = _by_worth(objective, refined, now)
    if not objective.scene.free:
        others = [_settled(objective, f, leader, now, known) for f in others]
        # settled, the leader would lead by more: that matters where another comes close
        close = worth(objective, leader, now) - THRESHOLDS.min_nats
        if any(worth(objective, f, now) > close for f in others):
            leader = _settled(objective, leader, leader, now, known)
    return _by_worth(objective, [leader, *others, *fits[_FINALISTS:]], now)


def _settled(
    objective: Objective, fit: Assessed, best: Assessed, now: Assessed, known: Slopes
) -> Assessed:
    """A fit with tolerances as they adapt around itself, if they adapt far and it is near the best.

    They are linear around the present hypothesis, and bent to what it lacks: where a sensor is
    quiet, what is linear there lets a law seem to leave several times what it does, and a wrong one
    that bends with the error gets ahead of the right one, which would need no bending.
    """
    bent = np.abs([fit.tolerances, fit.tolerances - now.tolerances]).max(initial=0.0)
    near = worth(objective, fit, now) >= _NEAR * worth(objective, best, now)
    if not (bent > FAR and near):
        return fit
    new = range(len(now.hypothesis), len(fit.hypothesis))
    return around_itself(objective, fit, now, new, known)


def _by_worth(objective: Objective, fits: Sequence[Assessed], now: Assessed) -> list[Assessed]:
    return sorted(fits, key=lambda f: -worth(objective, f, now))


def _refined(
    objective: Objective, hypotheses: Sequence[Hypothesis], now: Assessed, iterations: int
) -> list[Assessed]:
    """Only what was added to the present hypothesis is refined."""
    free = [range(len(now.hypothesis), len(h)) for h in hypotheses]
    return refine(objective, hypotheses, free, iterations)


@dataclass(frozen=True, eq=False)
class _More:
    """An addition at another joint: the best, what it was compared with, and on top of what."""

    fit: Assessed
    fits: list[Assessed]
    reference: Assessed


def _beside(
    screen: Screen,
    objective: Objective,
    best: Assessed,
    fits: Sequence[Assessed],
    now: Assessed,
) -> list[_More]:
    """Additions that earn a place at other joints once the best one is there, best first."""
    taken = dof_of(screen, best.hypothesis[-1].at)
    elsewhere = [
        f
        for f in fits
        if dof_of(screen, f.hypothesis[-1].at) not in (taken, -1)
        and worth(objective, f, now) > THRESHOLDS.min_nats
    ]
    chosen = _leading(screen, elsewhere, _searched(objective, now), 0, _EACH)
    if not chosen:
        return []
    reference = objective.reference(best.hypothesis)
    both = [(*best.hypothesis, *f.hypothesis[len(now.hypothesis) :]) for f in chosen]
    trials = _by_worth(objective, _refined(objective, both, reference, 2), reference)
    partners = []
    for dof in dict.fromkeys(dof_of(screen, f.hypothesis[-1].at) for f in trials):
        here = [f for f in trials if dof_of(screen, f.hypothesis[-1].at) == dof]
        winner = simplest(objective, here, reference)
        if earns(objective, winner, reference):
            partners.append(_More(winner, here, reference))
    return partners


def _accepted(
    objective: Objective,
    best: Assessed,
    fits: Sequence[Assessed],
    now: Assessed,
    shapes: dict[Key, Shape | None],
) -> list[Accepted]:
    """Effects of the best addition; what came close is remembered beside its last one."""
    gain = worth(objective, best, now)
    new = best.hypothesis[len(now.hypothesis) :]
    names = {p.key for p in new}
    rivals = tuple(
        f.hypothesis[-1]
        for f in fits
        if f.hypothesis[-1].key not in names
        and worth(objective, f, now) > gain - THRESHOLDS.equivalent_nats
    )
    last = len(new) - 1
    return [Accepted(p, shapes.get(p.key), rivals if i == last else ()) for i, p in enumerate(new)]


def _first_of_each(
    screen: Screen, objective: Objective, now: Assessed, additions: Sequence[Planted]
) -> list[Hypothesis]:
    """One start for each effect and place, the best of those that are given, and only the best."""
    best = _best_of_each(objective.evaluate([(*now.hypothesis, p) for p in additions]))
    # a start may be far off and its effect still right: a few that are worse than nothing stay
    ordered = sorted(best, key=lambda a: -a.loglik)
    finite = [a for a in ordered if np.isfinite(a.loglik)]
    return [
        a.hypothesis for a in _leading(screen, finite, _searched(objective, now), _STARTS, _STARTED)
    ]


def _best_of_each(fits: Sequence[Assessed]) -> list[Assessed]:
    """The likeliest of those that end in the same effect at the same place."""
    by_key: dict[Key, Assessed] = {}
    for fit in fits:
        key = fit.hypothesis[-1].key
        if key not in by_key or fit.loglik > by_key[key].loglik:
            by_key[key] = fit
    return list(by_key.values())


def _searched(objective: Objective, now: Assessed) -> list[int]:
    """Joints that get starts of their own; where the base floats, all joints err together."""
    return [] if objective.scene.free else erring_joints(objective, now)


def _leading(
    screen: Screen, ordered: Sequence[Assessed], erring: Container[int], overall: int, each: int
) -> list[Assessed]:
    """The first of a list, and the first of what acts on one erring joint alone."""
    count: dict[int, int] = {}
    leaders = []
    for i, assessed in enumerate(ordered):
        dof = dof_of(screen, assessed.hypothesis[-1].at)
        count[dof] = count.get(dof, 0) + 1
        if i < overall or (dof in erring and count[dof] <= each):
            leaders.append(assessed)
    return leaders
