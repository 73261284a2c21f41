"""Naming: which effects of the search are claimed, which are doubted, and what is left unknown.

A name is kept if it improves the fit of held-out recordings, and if no nonparametric force at its
joint predicts much better: a law of the library always fits something, and is the right one only if
a regression of any shape on positions, velocities and time, which must predict blocks of time that
it has not seen, cannot beat it by much (:mod:`~wt.diagnose.selection.rivalry`). What then remains,
and improves the held-out fit when it is learned, is reported as unknown.

Every model is off by a few per cent, which is no finding, and is corrected beside a finding
(:mod:`~wt.diagnose.selection.calibration`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose.likelihood.bic import erring_joints, merit
from wt.diagnose.likelihood.estimate import (
    Estimated,
    distances_from_nothing,
    estimate,
    fitted,
)
from wt.diagnose.likelihood.moments import momentary
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.residual.screen import Screen
from wt.diagnose.residual.signature import unsaid
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.alternatives import (
    Lookalikes,
    back_again,
    gave_way,
)
from wt.diagnose.selection.calibration import calibration
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.forms import in_best_form
from wt.diagnose.selection.holdout import (
    Gain,
    Holdout,
    gains_with_tolerances,
    lead_with_tolerances,
)
from wt.diagnose.selection.in_turn import where_mute
from wt.diagnose.selection.leaving import weakest_of_each
from wt.diagnose.selection.memory import Memory
from wt.diagnose.selection.plain import NO_CURVES, Curves, curves_in_disguise
from wt.diagnose.selection.rivalry import joint_of, rivals_nonparametric
from wt.diagnose.selection.simpler import simplified, united
from wt.diagnose.stop import stopped
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.force import Unknown, find
from wt.physics.planted import Hypothesis, Key, Planted, without

_FEW = 3
"""Of more effects than these, the hopeless leave before anything else is asked of them."""


@dataclass(frozen=True, eq=False)
class Naming:
    """Decides which effects are claimed, by all the evidence there is.

    Attributes:
        screen: the force residual.
        search_replays: replays by which the search compared hypotheses.
        objective: replays of all fitted data.
        all_replays: makes replays of these and of the held-out recordings, once it is asked.
        holdout: held-out recordings.
        step: physics step of replays [s].
        seed: of everything random.
        log: grows by every decision.
        shorter: makes the same recordings in the shortest windows, where ``holdout`` has longer
            ones: there a law shows at once that a small error of a constant force drowns in these.
    """

    screen: Screen
    search_replays: Objective
    objective: Objective
    all_replays: Callable[[], Objective]
    holdout: Holdout
    step: float
    seed: int
    log: DecisionLog
    shorter: Callable[[], Holdout] | None = None

    @functools.cached_property
    def memory(self) -> Memory:
        """What searches with these replays tried: not again where a joint is as it was."""
        return Memory(self.search_replays)

    def proven(
        self, accepted: tuple[Accepted, ...], attempts: int = 1, known: Container[Key] = ()
    ) -> Claims:
        """Only what is certain and improves the held-out fit stays, estimated without the rest.

        Args:
            accepted: effects that the search found.
            attempts: how often held-out data have been asked; all that is asked has to be paid.
            known: effects that were compared with their lookalikes, and proven, before: what others
                are asked later is not theirs to pay.
        """
        objective, log = self.objective, self.log
        accepted = in_best_form(self.search_replays, objective, accepted, log)
        parts, beside = tuple(a.planted for a in accepted), None
        if len(accepted) > _FEW:
            now, limits = fitted(objective, parts), _limits(accepted, attempts, known)
            beside = now.hypothesis
            accepted, parts = self._hopeful(accepted, now, limits, known)
        estimated = estimate(objective, parts, beside)
        lookalikes = Lookalikes(self.screen, self.search_replays, objective, self.all_replays, log)
        found = accepted
        accepted, estimated = lookalikes.settled(accepted, estimated, known)
        aside = gave_way(found, accepted)
        accepted, estimated = simplified(objective, accepted, estimated, log)
        accepted, estimated = united(objective, accepted, estimated, log)
        aside = {a.planted.key: aside[a.planted.key] for a in accepted if a.planted.key in aside}
        return self._asked(accepted, estimated, aside, attempts, known)

    def _asked(
        self,
        accepted: tuple[Accepted, ...],
        estimated: Estimated,
        aside: dict[Key, Accepted],
        attempts: int,
        known: Container[Key],
    ) -> Claims:
        """What held-out data do not refuse; what gave way to a refused lookalike is asked then.

        Args:
            accepted: effects.
            estimated: their parameters.
            aside: what gave way, by the keys of the lookalikes.
            attempts: as in :meth:`proven`.
            known: likewise.
        """
        limits = _limits(accepted, attempts, known)
        while accepted:
            fewer = estimated.hypothesis
            uncertain = self._uncertain(estimated)
            for i in sorted(uncertain, reverse=True):
                accepted, fewer = _less(accepted, fewer, i)
            if not uncertain:
                each, weak = self._judged(estimated.assessed, limits)
                if not weak:
                    for planted, g in zip(estimated.hypothesis, each, strict=True):
                        limit = limits[planted.key]
                        self.log.add(planted, "holdout", True, g.p_value, limit, "proven")
                    return Claims(accepted, estimated, tuple(each), ())
                accepted, fewer = self._without_refused(
                    accepted, estimated.assessed, each, weak, limits
                )
            left = len(accepted)
            accepted, fewer = back_again(aside, accepted, fewer)
            if len(accepted) > left:
                attempts += 1
                limits = _limits(accepted, attempts, known)
            estimated = estimate(self.objective, fewer, estimated.hypothesis)
        return Claims((), estimated, (), ())

    def _hopeful(
        self,
        accepted: tuple[Accepted, ...],
        now: Assessed,
        limits: Mapping[Key, float],
        known: Container[Key],
    ) -> tuple[tuple[Accepted, ...], Hypothesis]:
        """Effects, those that are known and those of which held-out data show anything at all.

        Of many that were found, only what may be proven is worth its comparison with lookalikes: a
        search without the refused ones will come to these.
        """
        each, _ = self._judged(now, limits)
        hypothesis = now.hypothesis
        hopeless = [
            i
            for i, (p, g) in enumerate(zip(hypothesis, each, strict=True))
            if p.key not in known and g.p_value > THRESHOLDS.hopeless
        ]
        for i in reversed(hopeless):
            planted, p = hypothesis[i], each[i].p_value
            reason = "held-out replays gain nothing by it"
            self.log.add(planted, "holdout", False, p, limits[planted.key], reason)
            accepted, hypothesis = _less(accepted, hypothesis, i)
        return accepted, hypothesis

    def _judged(self, now: Assessed, limits: Mapping[Key, float]) -> tuple[list[Gain], list[int]]:
        """Gain of each effect, and those that are not proven, weakest first."""
        each = self._gains(now)
        pairs = zip(each, now.hypothesis, strict=True)
        over = np.array([g.p_value / limits[p.key] for g, p in pairs])
        return each, [int(i) for i in np.argsort(-over, kind="stable") if over[i] > 1.0]

    def _without_refused(
        self,
        accepted: tuple[Accepted, ...],
        now: Assessed,
        each: Sequence[Gain],
        weak: Sequence[int],
        limits: Mapping[Key, float],
    ) -> tuple[tuple[Accepted, ...], Hypothesis]:
        """Effects without the weakest, and without those that are not proven without it either.

        A fit says of all but the last whether they are: it costs a part of an estimate. Where
        drives hold a machine, what one joint lacks is not what another does: the weakest of each
        leave together.
        """
        reason = "held-out replays do not clearly gain by it"
        while True:
            leaving = weakest_of_each(self.objective, now.hypothesis, weak)
            for i in leaving:
                planted, p = now.hypothesis[i], each[i].p_value
                self.log.add(planted, "holdout", False, p, limits[planted.key], reason)
            fewer = now.hypothesis
            for i in sorted(leaving, reverse=True):
                accepted, fewer = _less(accepted, fewer, i)
            if len(leaving) == len(weak):
                return accepted, fewer
            now = fitted(self.objective, fewer, now.hypothesis)
            each, weak = self._judged(now, limits)
            if not weak:
                return accepted, now.hypothesis

    def claimed(self, proven: Claims) -> Claims:
        """Doubt names, learn what is left, and correct the model's tolerances."""
        claims = self._doubted(proven)
        corrections = calibration(
            self.objective, self.holdout, claims.hypothesis, self.step, self.log
        )
        return replace(claims, corrections=corrections)

    def further(self, earlier: Claims, later: Claims) -> Claims:
        """What was proven later, unless what was proven earlier is more likely.

        On the fitted recordings, with the tolerances adapting around the later one.
        """
        objective, before, after = self.objective, earlier.estimated.assessed, later.estimated
        now = objective.reference(after.hypothesis, after.assessed.tolerances)
        (then,) = objective.evaluate([before.hypothesis], [before.tolerances])
        lead = merit(objective, now) - merit(objective, then)
        if lead >= 0.0:
            return later
        kept = {a.planted.key for a in later.accepted}
        for a in (a for a in earlier.accepted if a.planted.key not in kept):
            reason = "what took its place was refused, and without it less is explained"
            self.log.add(a.planted, "reconsidered", True, lead, 0.0, reason)
        objective.reference(before.hypothesis, before.tolerances)
        return earlier

    def clean(self, claims: Claims) -> bool:
        """True if nothing but noise is left of the fitted recordings."""
        return not erring_joints(self.objective, claims.assessed(self.objective))

    def _doubted(self, proven: Claims) -> Claims:
        """The named effects, or what is left of them without those that are given up."""
        named = self._with_unknown(proven)
        hypothesis = proven.estimated.hypothesis
        curves = curves_in_disguise(self.objective, self.holdout, hypothesis, self.step, self.log)
        doubtful = {
            i
            for i in range(len(proven.accepted))
            if i in curves.replaced or self._doubtful(proven, i)
        }
        together = self._standing_in(named)
        ways = dict.fromkeys(frozenset(i) for i in (doubtful | together, doubtful) if i)
        for given_up in ways:
            rest = tuple(a for i, a in enumerate(proven.accepted) if i not in given_up)
            others = self.proven(rest, known={a.planted.key for a in rest})
            unnamed = self._with_unknown(replace(others, events=proven.events), curves)
            if self._better(unnamed, named, bool(curves), bool(given_up & together)):
                return unnamed
            for i in sorted(given_up):
                reason = "nothing without a name is proven to predict held-out recordings better"
                laws = float(len(unnamed.unknown))
                self.log.add(hypothesis[i], "doubted", True, laws, 1.0, reason)
        return named

    def _standing_in(self, named: Claims) -> set[int]:
        """Names at joints that err although something unknown was learned beside several of them.

        They may stand in for one law together, each for a part that it says better than others do.
        """
        objective, scene = self.objective, self.objective.scene
        if not named.unknown:
            return set()
        erring = erring_joints(objective, objective.reference(named.hypothesis))
        dofs = {scene.dof(u.planted.at.name) for u in named.unknown} & set(erring)
        at = [scene.dof_at(a.planted.at) for a in named.accepted]
        return {i for i, dof in enumerate(at) if dof in dofs and at.count(dof) > 1}

    def _uncertain(self, estimated: Estimated) -> list[int]:
        """Indices of effects that leave: one that some recording contradicts, or may be nothing.

        Of those that may as well be nothing the weakest; of each joint where drives hold a machine.
        Nothing, if all are both possible and certain.
        """
        for i, p in enumerate(estimated.hypothesis):
            for motion in (self.screen.motion, self.holdout.smoothed.motion):
                reason = p.wrong(motion)
                if reason is not None:
                    self.log.add(p, "contradicted", False, 1.0, 0.0, reason)
                    return [i]
        widths = distances_from_nothing(estimated)
        if not widths:
            return []
        weak = sorted(widths, key=widths.__getitem__)
        leaving = weakest_of_each(self.objective, estimated.hypothesis, weak)
        for i in leaving:
            nothing = "its 95 % interval holds nothing at all"
            self.log.add(estimated.hypothesis[i], "certainty", False, widths[i], 0.5, nothing)
        return leaving

    def _gains(self, assessed: Assessed) -> list[Gain]:
        """Gain of each effect: all of them against all but this one.

        On held-out data, or on the fitted ones where those cannot say; either kind of test pays
        for how many there are of it, and one in shorter windows for having been the second.
        """
        objective = self.objective
        all_but_one = [without(assessed.hypothesis, i) for i in range(len(assessed.hypothesis))]
        sides = [assessed, *objective.evaluate(all_but_one)]
        full, each = gains_with_tolerances(objective, self.holdout, sides, self.step)
        each = where_mute(objective, self.holdout, assessed, full, each, self.step)
        if self.shorter and any(g.p_value > THRESHOLDS.significant for g in each):
            _, once_more = gains_with_tolerances(objective, self.shorter(), sides, self.step)
            paid = [replace(g, p_value=min(1.0, 2.0 * g.p_value)) for g in once_more]
            each = [min(pair, key=lambda g: g.p_value) for pair in zip(each, paid, strict=True)]
        return [
            replace(g, p_value=1.0) if p.momentary() and g.share < THRESHOLDS.momentary_share else g
            for p, g in zip(assessed.hypothesis, each, strict=True)
        ]

    def _with_unknown(self, claims: Claims, curves: Curves = NO_CURVES) -> Claims:
        """Learn what is left beside some joints' curves, as long as the held-out fit improves.

        Where the search was ended before its time, nobody knows that it has no name.
        """
        if stopped() or self.clean(claims):
            return claims
        assessed = claims.assessed(self.objective)
        rest = assessed.hypothesis
        laws = curves.learned(self.screen, rest, self.holdout, self.step, self.seed)
        if laws:
            assessed = self.objective.reference((*rest, *(u.planted for u in laws)))
        found: Sequence[Unknown] = ()
        while len(laws) < THRESHOLDS.most_unknown:
            found = find(
                self.screen, self.objective, assessed, self.holdout, step=self.step, seed=self.seed
            )
            unknown = next((u for u in found if u.proven), None)
            if unknown is None or any(unknown.planted.at == u.planted.at for u in laws):
                break
            laws.append(unknown)
            p, limit = unknown.gain.p_value, THRESHOLDS.significant
            self.log.add(unknown.planted, "unknown", True, p, limit, "a learned law predicts it")
            assessed = self.objective.reference((*assessed.hypothesis, unknown.planted))
        claims = replace(claims, unknown=tuple(laws), suspected=self._suspected(found))
        if claims.hypothesis:
            return claims
        return replace(claims, moments=momentary(self.objective, assessed))

    def _suspected(self, found: Sequence[Unknown]) -> tuple[Unknown, ...]:
        """Of forces whose laws are not proven, those that are no noise."""
        suspected = tuple(u for u in found if u.suspected and not u.proven)
        for u in suspected:
            p, limit = u.gain.p_value, THRESHOLDS.significant
            reason = "a law predicts times that it has not seen; held-out replays do not prove it"
            self.log.add(u.planted, "unknown", False, p, limit, reason)
        return suspected

    def _doubtful(self, claims: Claims, index: int) -> bool:
        rivalry = rivals_nonparametric(self.screen, claims.hypothesis, index, seed=self.seed)
        if rivalry is None:
            return False
        doubtful = rivalry.ratio < THRESHOLDS.doubtful
        columns = ", ".join(rivalry.depends_on)
        reason = f"a force of any shape of {columns} predicts {'far' if doubtful else 'no'} better"
        planted = claims.hypothesis[index]
        self.log.add(planted, "doubted", not doubtful, rivalry.ratio, THRESHOLDS.doubtful, reason)
        return doubtful

    def _better(
        self, unnamed: Claims, named: Claims, curves: bool = False, standing_in: bool = False
    ) -> bool:
        """True if an unnamed law predicts held-out data better, significantly and materially.

        It is none if it says what the names say; of several that stand in for one, none says it.

        Times that were read off the held-out data, too, predict nothing, and names with such among
        them predict less than they seem to: in their place the law has to be no worse. So it has
        in place of curves in disguise.
        """
        if not unnamed.unknown or not (curves or standing_in or not self._theirs(unnamed, named)):
            return False
        replaced = _replaced(unnamed, named)
        read_off = bool(replaced) and all(p.observed() for p in replaced)
        read_off = read_off or curves or any(p.momentary() for p in replaced)
        one, other = (named, unnamed) if read_off else (unnamed, named)
        sides = one.hypothesis, other.hypothesis
        lead = lead_with_tolerances(self.objective, self.holdout, *sides, self.step)
        significant = lead.p_value <= THRESHOLDS.significant
        better = (significant and lead.share >= THRESHOLDS.unknown_share) != read_off
        reason = "the named effects are given up for it" if better else "no better than the names"
        for law in unnamed.unknown:
            p, limit = lead.p_value, THRESHOLDS.significant
            self.log.add(law.planted, "doubted", better, p, limit, reason)
        return better

    def _theirs(self, unnamed: Claims, named: Claims) -> bool:
        """True if the unnamed laws are no others than those of the effects they would replace."""
        motion, replaced = self.screen.motion, _replaced(unnamed, named)
        for law in (u.planted for u in unnamed.unknown):
            dof = motion.scene.dof(law.at.name)
            here = [p for p in replaced if joint_of(motion.scene, p.at) == law.at.name]
            share, limit = unsaid(motion, law, here, dof), THRESHOLDS.same_law
            if share > limit:
                return False
            reason = f"the learned law is that of {', '.join(str(p) for p in here)}"
            self.log.add(law, "doubted", False, share, limit, reason)
        return True


def _limits(accepted: Sequence[Accepted], attempts: int, known: Container[Key]) -> dict[Key, float]:
    """Significance that each effect must reach: all that is asked of held-out data is paid."""
    one = THRESHOLDS.significant
    keys = [a.planted.key for a in accepted]
    return {key: one if key in known else one / attempts for key in keys}


def _less(
    accepted: tuple[Accepted, ...], hypothesis: Hypothesis, index: int
) -> tuple[tuple[Accepted, ...], Hypothesis]:
    """Effects, and as they are estimated, without one."""
    return tuple(a for i, a in enumerate(accepted) if i != index), without(hypothesis, index)


def _replaced(unnamed: Claims, named: Claims) -> list[Planted]:
    """Named effects in whose place unnamed laws would be."""
    kept = {a.planted.key for a in unnamed.accepted}
    return [p for p in named.estimated.hypothesis if p.key not in kept]
