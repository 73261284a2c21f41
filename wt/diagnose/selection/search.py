"""Search for effects: they join while they earn it, and leave again if they stop doing so.

Each round ends no lower than it began, so that no state that was passed is better than the result:
a round that goes downhill is taken back, and the search goes on without what joined in it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TypeVar

from wt.diagnose.likelihood.bic import earns, erring_joints, exhausted, merit, worth
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import NO_SLOPES, Slopes, all_slopes, refine, together
from wt.diagnose.likelihood.tolerances import taken_over
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.addition import Accepted, Incumbent, addition, replacement
from wt.diagnose.selection.alike import alike
from wt.diagnose.selection.candidates import dof_of
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.in_turn import left_in_turn
from wt.diagnose.selection.leaving import weakest_of_each
from wt.diagnose.selection.memory import Memory
from wt.diagnose.selection.several import several
from wt.diagnose.selection.simpler import by_what_they_became
from wt.diagnose.stop import StoppedError, stoppable, stopped
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Shape
from wt.physics.planted import Hypothesis, Key, Planted, without

S = TypeVar("S")
DOWNHILL = 2
"""At most this many rounds that went downhill are tried anew without what they added."""
FEW = 3
"""So many effects that joined in one round are all looked for again."""


def search(
    screen: Screen,
    objective: Objective,
    log: DecisionLog,
    report: Callable[[int, int], None] | None = None,
    start: Sequence[Accepted] = (),
    banned: Container[Key] = frozenset(),
    memory: Memory | None = None,
) -> tuple[Accepted, ...]:
    """Add effects while they earn their place.

    Args:
        screen: the force residual.
        objective: the replays.
        log: grows by every decision.
        report: called with (number of the effect that is looked for, joints that err).
        start: effects to start from.
        banned: effects at places that have been found to predict nothing.
        memory: of earlier searches with the same replays.

    Returns:
        The effects in the order in which they were added.
    """
    latest, tried = list[Accepted](), memory or Memory(objective)  # what joined in the last round

    def advance(state: _State, refused: Container[Key]) -> tuple[_State, set[Key]]:
        latest.clear()
        full = len(state.accepted) >= THRESHOLDS.most_effects
        if full or exhausted(objective, state.now):
            return state, set()
        if report:
            report(len(state.accepted) + 1, len(erring_joints(objective, state.now)))
        union = _Union(banned, refused)
        after = _round(screen, objective, state, log, union, tried, latest)
        return after, {a.planted.key for a in latest} | (after.names - state.names)

    def lead(after: _State, state: _State) -> float:
        # likelihoods compare only where the same may adapt: both around the later state
        (before,) = objective.evaluate([state.now.hypothesis], [state.now.tolerances])
        return merit(objective, after.now) - merit(objective, before)

    def back(state: _State, joined: set[Key], lead: float) -> _State:
        reason = "the round that it joined ends below where it began"
        for a in (a for a in latest if a.planted.key in joined):
            log.add(a.planted, "reconsidered", False, lead, 0.0, reason)
        return replace(state, now=objective.reference(state.now.hypothesis, state.now.tolerances))

    known = tuple(a.planted for a in start)
    begin = _State(list(start), _fitted(objective, known) if known else objective.reference(()))
    with stoppable():
        end = uphill(begin, advance, lead, lambda s: s.names, back)
    if latest and stopped() and not {a.planted.key for a in latest} <= end.names:
        # ended amid a round: what joined in it is the best so far
        hypothesis = (*end.now.hypothesis, *(a.planted for a in latest))
        more = _State([*end.accepted, *latest], _fitted(objective, hypothesis))
        end = more if lead(more, end) > 0.0 else end
    return tuple(
        replace(a, planted=planted)
        for a, planted in zip(end.accepted, end.now.hypothesis, strict=True)
    )


def uphill(
    state: S,
    advance: Callable[[S, Container[Key]], tuple[S, set[Key]]],
    lead: Callable[[S, S], float],
    names: Callable[[S], set[Key]],
    back: Callable[[S, set[Key], float], S],
) -> S:
    """Go on from state to state, and never end below one that was passed.

    Whoever asks for an earlier end (:mod:`~wt.diagnose.stop`) gets the best so far.

    Args:
        state: where to begin.
        advance: one round from a state, without what is refused; the next state and what joined.
        lead: merit of a state over an earlier one; only states that lead are kept.
        names: effects of a state.
        back: restores a state after a round from it went downhill, given what joined and the lead.
    """
    refused: set[Key] = set()
    downhill = 0
    with suppress(StoppedError):
        while downhill <= DOWNHILL:
            after, joined = advance(state, refused)
            if not joined:
                break
            gained = lead(after, state)
            lasted = not names(after) <= names(state)
            if gained > 0.0:
                state = after
            elif lasted:
                # go on from where the round began, without what it added
                downhill += 1
                refused |= joined
                state = back(state, joined, gained)
            if not lasted:
                break
    return state


@dataclass(frozen=True, eq=False)
class _State:
    """Present hypothesis of a search.

    Attributes:
        accepted: its effects.
        now: the same, assessed.
        slopes: derivatives in them, as far as they are known.
    """

    accepted: list[Accepted]
    now: Assessed
    slopes: Slopes = field(default_factory=lambda: NO_SLOPES)

    @property
    def names(self) -> set[Key]:
        """Effects and their places."""
        return {a.planted.key for a in self.accepted}


class _Union(Container[Key]):
    """Members of any of some containers."""

    def __init__(self, *parts: Container[Key]) -> None:
        """Hold the containers, which may still grow."""
        self._parts = parts

    def __contains__(self, key: object) -> bool:
        """Whether any of them has it."""
        return any(key in part for part in self._parts)


def _round(
    screen: Screen,
    objective: Objective,
    state: _State,
    log: DecisionLog,
    banned: Container[Key],
    tried: Memory,
    latest: list[Accepted],
) -> _State:
    """A state after one more round; ``latest`` is filled with what joined in it."""
    room = THRESHOLDS.most_effects - len(state.accepted)
    latest[:] = addition(screen, objective, state.now, state.accepted, log, room, banned, tried)
    after = _joined(objective, state, latest, log) if latest else state
    if not _foretold(objective, after, latest, log):
        latest.clear()
        after = state
        objective.reference(state.now.hypothesis, state.now.tolerances)
    after = _exchanged(objective, after, log, banned, tried, everywhere=not latest)
    return _reconsidered(screen, objective, after, log, banned, latest)


def _joined(
    objective: Objective, state: _State, joined: Sequence[Accepted], log: DecisionLog
) -> _State:
    """A state once effects have joined it and the superfluous have left."""
    accepted = [*state.accepted, *joined]
    hypothesis = (*state.now.hypothesis, *(a.planted for a in joined))
    return _prune(objective, _State(accepted, _fitted(objective, hypothesis)), log)


def _foretold(
    objective: Objective, state: _State, joined: Sequence[Accepted], log: DecisionLog
) -> bool:
    """Tell whether recordings foretell each other better by what joined, or few effects are there.

    Where a machine follows no law exactly, there is always one more that fits what it did. With
    many there, at least one of those that join has to show in parts that it was not fitted to.
    """
    few = THRESHOLDS.many_effects * len(objective.scene.joints)
    if len(state.accepted) <= few or objective.scene.free:
        return True
    names = {a.planted.key for a in joined}
    asked = [i for i, p in enumerate(state.now.hypothesis) if p.key in names]
    slopes, gains = all_slopes(objective, state.now, state.slopes), []
    for i in asked:
        gains.append(left_in_turn(objective, state.now.hypothesis, i, slopes).p_value)
        if gains[-1] <= THRESHOLDS.hopeless:
            return True
    for i, p_value in zip(asked, gains, strict=True):
        reason = "recordings left out in turn gain nothing by it, and many effects are there"
        log.add(state.now.hypothesis[i], "holdout", False, p_value, THRESHOLDS.hopeless, reason)
    return not asked


def _exchanged(
    objective: Objective,
    state: _State,
    log: DecisionLog,
    banned: Container[Key],
    memory: Memory,
    everywhere: bool,
) -> _State:
    """A state in which several laws of a joint together have taken the place of what it had.

    Asked where a joint errs with all that was found, as it does where that only stands in for them;
    where nothing was found, it is once no single effect joins any more. All joints that err are
    asked together then, too, and before that where most of a machine's do.
    """
    for dof in erring_joints(objective, state.now):
        _, had = _apart(objective, state, [dof])
        if not (had or everywhere) or not memory.unasked(state.now, dof):
            continue
        laws = several(objective, state.now, dof, banned)
        state = _instead(objective, state, [dof], laws, log)
    erring = erring_joints(objective, state.now)
    many = len(erring) > max(2, len(objective.scene.joints) // 2)
    if (many or (everywhere and len(erring) > 1)) and memory.unasked_together(state.now, erring):
        laws = alike(objective, state.now, erring, banned)
        state = _instead(objective, state, erring, laws, log)
    return state


def _instead(
    objective: Objective,
    state: _State,
    dofs: Collection[int],
    laws: Sequence[tuple[Planted, Shape]],
    log: DecisionLog,
) -> _State:
    """Laws in the place of all that joints have, if replays of them, refined, are clearly ahead.

    Else the state and the replays stay as they were, to the bit.
    """
    others, had = _apart(objective, state, dofs)
    if {p.key for p, _ in laws} <= {a.planted.key for a in had}:
        return state
    accepted = [*others, *(Accepted(p, shape, ()) for p, shape in laws)]
    # what the others do changes little with the laws that take a place beside them
    slopes = state.slopes if objective.forgets else NO_SLOPES
    known = {a.planted.key: slopes[a.planted.key] for a in others if a.planted.key in slopes}
    fit = _fitted(objective, tuple(a.planted for a in accepted), state.now.hypothesis, known)
    after = _State(accepted, fit, known)
    # even if none of the laws had to be paid for
    most = replace(fit, hypothesis=tuple(a.planted for a in others))
    if merit(objective, most) > merit(objective, state.now):
        after = _prune(objective, after, DecisionLog(), dofs)
    lead, least = worth(objective, after.now, state.now), THRESHOLDS.min_nats
    ahead = merit(objective, after.now) > merit(objective, state.now)
    taken = ahead and earns(objective, after.now, state.now)
    _, here = _apart(objective, after, dofs)
    said = " and ".join(str(a.planted) for a in here)
    reason = f"{said} together {'take its place' if taken else 'are not clearly ahead'}"
    for a in had:
        log.add(a.planted, "reconsidered", not taken, lead, least, reason)
    if not taken:
        objective.reference(state.now.hypothesis, state.now.centre, most=1)
        return state
    for a in (a for a in after.accepted if a.planted.key not in state.names):
        log.add(a.planted, "joined", True, lead, least, f"of {said} together")
    return after


def _apart(
    objective: Objective, state: _State, dofs: Collection[int]
) -> tuple[list[Accepted], list[Accepted]]:
    """Effects of a state as they are now: those elsewhere, and those at single joints."""
    pairs = zip(state.accepted, state.now.hypothesis, strict=True)
    present = [replace(a, planted=p) for a, p in pairs]
    here = [objective.scene.dof_at(a.planted.at) in dofs for a in present]
    others = [a for a, its in zip(present, here, strict=True) if not its]
    return others, [a for a, its in zip(present, here, strict=True) if its]


def _fitted(
    objective: Objective,
    hypothesis: Hypothesis,
    beside: Hypothesis | None = None,
    known: Slopes = NO_SLOPES,
) -> Assessed:
    """All effects of a hypothesis refined together, with the objective linear around them.

    Args:
        objective: the replays.
        hypothesis: the effects.
        beside: effects beside which tolerances do much the same.
        known: derivatives in some parts, as near as where others were beside them.
    """
    now = objective.reference(hypothesis, beside=beside)
    every = [range(len(hypothesis))]
    (now,) = refine(objective, [now.hypothesis], every, iterations=3, known=known)
    return objective.reference(now.hypothesis, now.tolerances)


def _reconsidered(
    screen: Screen,
    objective: Objective,
    state: _State,
    log: DecisionLog,
    banned: Container[Key],
    added: Sequence[Accepted],
) -> _State:
    """Each of some effects that joined together and are still there is looked for, in its place.

    Two at one joint were chosen by the force residual, and few others were replayed in their
    place. Of many that joined only such pairs are looked for again: each costs a whole round.
    What is known of the slopes in all of them holds until one is replaced.
    """
    accepted, now, slopes = state.accepted, state.now, state.slopes
    dofs = [dof_of(screen, a.planted.at) for a in added]
    again = [
        a for a, dof in zip(added, dofs, strict=True) if len(added) <= FEW or dofs.count(dof) > 1
    ]
    for key in [a.planted.key for a in again] if len(added) > 1 else ():
        index = next((i for i, a in enumerate(accepted) if a.planted.key == key), None)
        if index is None:  # replaced or pruned already
            continue
        rest = [a for i, a in enumerate(accepted) if i != index]
        slopes = slopes or all_slopes(objective, now)
        (fit,) = _lesser(objective, now, [index], slopes)
        base = objective.reference(fit.hypothesis, fit.tolerances)
        kept = [replace(a, planted=p) for a, p in zip(rest, base.hypothesis, strict=True)]
        present = Incumbent(accepted[index].planted, now.loglik)
        found = replacement(screen, objective, base, kept, log, banned, present)
        if found is not None and found.planted.key not in {a.planted.key for a in accepted}:
            other = _fitted(objective, (*base.hypothesis, found.planted))
            lead = worth(objective, other, now)
            replaced = lead > THRESHOLDS.equivalent_nats
            log.add(
                accepted[index].planted,
                "reconsidered",
                not replaced,
                lead,
                THRESHOLDS.equivalent_nats,
                f"beside the others, {found.planted} "
                + ("takes its place" if replaced else "is not clearly ahead"),
            )
            if replaced:
                accepted, now, slopes = [*rest, found], other, NO_SLOPES
                continue
        now = objective.reference(now.hypothesis, now.tolerances)
    return _State(accepted, now, slopes)


def _prune(
    objective: Objective, state: _State, log: DecisionLog, dofs: Collection[int] | None = None
) -> _State:
    """Drop effects that the later ones made superfluous; of some joints only, if they are given.

    One that has become as small as any model's errors are is one of these. One that has become a
    simpler law is that, and not dropped for being no longer what it was.
    """
    accepted, hypothesis = by_what_they_became(objective, state.accepted, state.now.hypothesis, log)
    now, slopes = state.now, state.slopes
    if hypothesis is not now.hypothesis:
        now = _fitted(objective, hypothesis, known=slopes)
    while len(accepted) > 1:
        places = [objective.scene.dof_at(p.at) for p in now.hypothesis]
        asked = [i for i, at in enumerate(places) if dofs is None or at in dofs]
        slopes = all_slopes(objective, now, slopes)
        fits = dict(zip(asked, _lesser(objective, now, asked, slopes), strict=True))
        losses = {i: worth(objective, now, fit) for i, fit in fits.items()}
        first, *others = sorted(asked, key=losses.__getitem__)
        if losses[first] > THRESHOLDS.min_nats and earns(objective, now, fits[first]):
            break
        weak = [first, *(i for i in others if losses[i] <= THRESHOLDS.min_nats)]
        leaving, fit = weakest_of_each(objective, now.hypothesis, weak), fits[weak[0]]
        if len(leaving) > 1:
            together_gone = _gone(objective, now, leaving, slopes)
            if merit(objective, together_gone) > merit(objective, fit):
                fit = together_gone
            else:
                leaving = weak[:1]
        for i in leaving:
            reason = "the others say as much without it"
            log.add(accepted[i].planted, "pruned", False, losses[i], THRESHOLDS.min_nats, reason)
        accepted = [a for i, a in enumerate(accepted) if i not in leaving]
        slopes = slopes if objective.forgets else NO_SLOPES
        now = objective.reference(fit.hypothesis, fit.tolerances)
    return _State(accepted, now, slopes)


def _lesser(
    objective: Objective, now: Assessed, each: Sequence[int], slopes: Slopes
) -> list[Assessed]:
    """A hypothesis without each of some effects; ``now`` is the reference.

    Others that act on the limbs of what leaves are refined.
    """
    lesser = [without(now.hypothesis, i) for i in each]
    free = [[k - (k > i) for k in together(objective, now.hypothesis, [i]) if k != i] for i in each]
    errors = [taken_over(objective.tolerances, now.tolerances, now.hypothesis[i]) for i in each]
    return refine(objective, lesser, free, iterations=2, centres=errors, known=slopes)


def _gone(objective: Objective, now: Assessed, leaving: Sequence[int], slopes: Slopes) -> Assessed:
    """A hypothesis without some effects of different joints, all others refined."""
    fewer = tuple(p for i, p in enumerate(now.hypothesis) if i not in leaving)
    errors = now.tolerances
    for i in leaving:
        errors = taken_over(objective.tolerances, errors, now.hypothesis[i])
    every = [range(len(fewer))]
    return refine(objective, [fewer], every, iterations=2, centres=[errors], known=slopes)[0]
