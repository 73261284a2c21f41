"""Alternatives to a law that was found: its lookalikes.

The search compares many hypotheses on a part of the data, most of them hardly refined. A joint
under a load of one sign, say, is pushed aside by a constant, and it takes every motion recorded to
tell a drive's dead band from its bias, from play in the gear or from an encoder's zero. So each
effect that was found is compared once more with its lookalikes, all of them refined, on all
recordings, the held-out ones among them. That decides which of them it is. Whether there is one,
and how large it is, remain to be proven and estimated.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, get_args

import numpy as np

from wt.diagnose.likelihood.bic import (
    odds_against,
    price,
    room,
    size,
    worth,
)
from wt.diagnose.likelihood.estimate import Estimated, estimate
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import (
    NO_SLOPES,
    Slopes,
    around_itself,
    jacobian,
    refine,
    slopes_of,
    together,
)
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.addition import FAR, HOPELESS, Accepted
from wt.diagnose.selection.candidates import Start, excluded, lookalikes
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Common, Shape, effects
from wt.physics.hooks import shaped
from wt.physics.planted import Hypothesis, Key, Planted, without
from wt.types import Location


class Option(NamedTuple):
    """A law in the place of the one that was found.

    Attributes:
        law: effect, place, parameters.
        lead: over the law that was found, which has none [nats].
        evidence: the same without what is known of effects beforehand [nats].
    """

    law: Planted
    lead: float
    evidence: float

    @property
    def usual(self) -> int:
        """Grade of how many machines have it."""
        return get_args(Common).index(self.law.effect.common)


_STARTS, _STEPS = 2, 2
"""So many starts of each lookalike get so many steps, then the best, then that on all data, …"""
_FAR = 120.0
"""… unless they are so many nats worse than what was found before the second, and hopeless before
the third."""


class _Decided(NamedTuple):
    """What was refined on deciding replays.

    Attributes:
        deciding: these.
        hypothesis: what was found.
        now: the same, refined.
        slopes: its own.
    """

    deciding: Objective
    hypothesis: Hypothesis
    now: Assessed
    slopes: Slopes


@dataclass(frozen=True, eq=False)
class Lookalikes:
    """Comparison of an effect with its lookalikes.

    Attributes:
        screen: the force residual, for where they start.
        search_replays: replays of a part of the fitted data, for their first steps.
        objective: replays of all of them.
        all_replays: makes replays of these and of the held-out recordings, once it is asked.
        log: grows by every decision.
        decided: what was refined last on the deciding replays, if anything was.
    """

    screen: Screen
    search_replays: Objective
    objective: Objective
    all_replays: Callable[[], Objective]
    log: DecisionLog
    decided: list[_Decided] = field(default_factory=list)

    def settled(
        self, accepted: tuple[Accepted, ...], estimated: Estimated, known: Container[Key] = ()
    ) -> tuple[tuple[Accepted, ...], Estimated]:
        """The same effects, each by the best of its lookalikes; what comes close is its rival.

        Args:
            accepted: effects.
            estimated: their parameters.
            known: effects that were compared before, and are not again.
        """
        present = estimated.assessed
        for i, now in enumerate(accepted):
            starts = () if now.planted.key in known else self._starts(accepted, present, i)
            if not starts:
                continue
            options = self._compared(present.hypothesis, i, [p for p, _ in starts])
            best = _best(options)
            other = present if best is options[0] else self._instead(present, i, best)
            if other is None:
                best, other = options[0], present
            self._log(now.planted, options, best)
            if best is not options[0]:
                now, present = Accepted(best.law, _shape(starts, best.law), ()), other
            now = replace(now, rivals=tuple(o.law for o in _rivals(options, best)))
            accepted = (*accepted[:i], now, *accepted[i + 1 :])
        if present is not estimated.assessed:
            estimated = estimate(self.objective, present.hypothesis, estimated.hypothesis)
        return accepted, estimated

    def _instead(self, present: Assessed, index: int, best: Option) -> Assessed | None:
        """Another law in the place of one, as replays around itself say; None if they refuse it.

        Options are compared with tolerances that are linear around the law that was found. That may
        lead a larger one astray: one that contains what was found cannot explain less, and is begun
        anew from there before it is refused.
        """
        found, law = present.hypothesis[index], best.law
        larger = found.beyond(effects()[law.effect.id], self.screen.motion)
        for starts in ([law.theta], [theta for _, theta in larger]):
            begun = [self._around(present, index, replace(law, theta=theta)) for theta in starts]
            other = max(begun, key=lambda fit: fit.loglik, default=None)
            if other is None:
                break
            if len(begun) > 1:
                other = self._around(present, index, other.hypothesis[index])
            due = _due(other.hypothesis, present.hypothesis)
            if worth(self.objective, other, present) - due > -THRESHOLDS.min_nats:
                return other
        return None

    def _around(self, present: Assessed, index: int, law: Planted) -> Assessed:
        """Effects with a law in the place of one, refined as replays around them say."""
        parts = (*present.hypothesis[:index], law, *present.hypothesis[index + 1 :])
        around = self.objective.reference(parts, beside=present.hypothesis)
        (other,) = refine(self.objective, [around.hypothesis], [range(len(parts))], _STEPS)
        return other

    def _log(self, planted: Planted, options: Sequence[Option], best: Option) -> None:
        """Log the lookalikes of an effect; ``options`` as in :meth:`_compared`, itself first."""
        first, limit = options[0], THRESHOLDS.evident_nats
        given_up = best is not first
        reason = "no law that looks alike is more likely"
        if given_up:
            reason = f"gives way to {best.law}, {best.lead:.3g} nats ahead on all recordings"
        self.log.add(first.law, "alternative", not given_up, best.lead, limit, reason)
        for o in options[1:]:
            reason = f"takes the place of {planted}" if o is best else f"not {planted}"
            self.log.add(o.law, "alternative", o is best, o.lead, limit, reason)

    def _starts(self, accepted: Sequence[Accepted], now: Assessed, index: int) -> list[Start]:
        """Lookalikes of an effect at its place or close to it, each from where it may start."""
        hypothesis, rivals = now.hypothesis, accepted[index].rivals
        present, rest = hypothesis[index], without(hypothesis, index)
        wanted = lookalikes(self.screen, present) | {(r.effect.id, r.at) for r in rivals}
        known = [
            (p, a.shape) for p, a in zip(hypothesis, accepted, strict=True) if p is not present
        ]
        ranked = [s for s in self.screen.rank(known, wanted) if np.isfinite(s.gain)]
        shapes: dict[Key, Shape | None] = {s.planted.key: s.shape for s in ranked}
        plain, larger = self._unscreened(present, wanted)
        plain = [*(s.planted for s in ranked), *rivals, *plain]
        possible = [
            (p, shape)
            for p, shape in (*((p, shapes.get(p.key)) for p in plain), *larger)
            if p.key != present.key and not any(excluded(p, r) for r in rest)
        ]
        # no fit is better than one that leaves nothing but noise: a larger law may not earn its due
        left, paid = room(self.objective, now), price(self.objective, (present,))
        return [
            (p, shape)
            for p, shape in possible
            if (due := _due((p,), (present,))) <= 0.0
            or price(self.objective, (p,)) - paid + due < left
        ]

    def _unscreened(
        self, present: Planted, wanted: Iterable[tuple[str, Location]]
    ) -> tuple[list[Planted], list[Start]]:
        """Of wanted effects those that the screen cannot see, and larger laws from the present."""
        motion = self.screen.motion
        plain: list[Planted] = []
        larger: list[Start] = []
        for name, at in sorted(wanted, key=str):
            effect = effects()[name]
            if at not in effect.places(motion.scene):
                continue
            if not effect.shapes(motion, at):
                plain += [Planted(effect, at, theta) for theta in effect.starts(motion, at)]
            if at == present.at:
                further = present.beyond(effect, motion)
                larger += [(Planted(shaped(effect, s), at, theta), s) for s, theta in further]
        return plain, larger

    def _compared(
        self, hypothesis: Hypothesis, index: int, starts: Sequence[Planted]
    ) -> list[Option]:
        """An effect, and its lookalikes in its place."""
        before = self.decided[-1].hypothesis if self.decided else None
        present = self.search_replays.reference(hypothesis, beside=before)
        tried = [(*hypothesis[:index], p, *hypothesis[index + 1 :]) for p in starts]
        begun = _best_of_each(self.search_replays.evaluate(tried), index, _STARTS)
        for _ in range(2):
            fits = refine(
                self.search_replays, [f.hypothesis for f in begun], [[index]] * len(begun), _STEPS
            )
            near_it = [f for f in fits if f.loglik > present.loglik - _FAR]
            begun = _best_of_each(near_it, index, 1)
        going = [f.hypothesis for f in begun if worth(self.search_replays, f, present) > -HOPELESS]
        if not going:
            return [Option(hypothesis[index], 0.0, 0.0)]
        events = any(p.observed() for p in hypothesis)  # at other times in other recordings
        deciding = self.objective if events else self.all_replays()
        now, slopes = self._decided(deciding, hypothesis)
        parts = now.hypothesis
        tried = [(*parts[:index], h[index], *parts[index + 1 :]) for h in going]
        # what the others do changes little with the law beside them
        known = {key: slope for key, slope in slopes.items() if key != parts[index].key}
        free = [together(deciding, h, [index]) for h in tried]
        others = refine(deciding, tried, free, _STEPS, known=known)
        now, others = _each_settled(deciding, hypothesis, now, others, index, known)
        options = [Option(hypothesis[index], 0.0, 0.0)]
        for fit in others:
            gained, due = worth(deciding, fit, now), _due(fit.hypothesis, hypothesis)
            evidence = gained + odds_against(fit.hypothesis) - odds_against(hypothesis)
            law = fit.hypothesis[index]
            options.append(Option(law, gained - due, evidence - max(due, 0.0)))
        return options

    def _decided(self, deciding: Objective, hypothesis: Hypothesis) -> tuple[Assessed, Slopes]:
        """What was found, refined on the deciding replays, with its slopes; once for all places."""
        before = self.decided.pop() if self.decided else None
        if before and before.deciding is not deciding:
            before = None
        deciding.reference(hypothesis, beside=before and before.hypothesis)
        if before is None or before.hypothesis != hypothesis:
            # what the others do changes little with the law that took a place beside them
            known = before.slopes if before and deciding.forgets else NO_SLOPES
            free = [range(len(hypothesis))]
            (now,) = refine(deciding, [hypothesis], free, _STEPS, known=known)
            (slope,) = jacobian(deciding, [now], free, known=known)
            before = _Decided(deciding, hypothesis, now, slopes_of(now.hypothesis, slope))
        self.decided.append(before)
        return before.now, before.slopes


def gave_way(found: Sequence[Accepted], settled: Sequence[Accepted]) -> dict[Key, Accepted]:
    """Effects whose places lookalikes took, by these."""
    pairs = zip(found, settled, strict=True)
    return {now.planted.key: was for was, now in pairs if was.planted.key != now.planted.key}


def back_again(
    aside: dict[Key, Accepted], accepted: tuple[Accepted, ...], hypothesis: Hypothesis
) -> tuple[tuple[Accepted, ...], Hypothesis]:
    """Effects, and those again that gave way to what is gone; these leave ``aside``.

    What a lookalike is refused for says nothing of them.
    """
    there = {a.planted.key for a in accepted}
    back = [aside.pop(key) for key in list(aside) if key not in there]
    return (*accepted, *back), (*hypothesis, *(a.planted for a in back))


def _each_settled(
    objective: Objective,
    hypothesis: Hypothesis,
    now: Assessed,
    others: Sequence[Assessed],
    index: int,
    known: Slopes,
) -> tuple[Assessed, list[Assessed]]:
    """What was found and its lookalikes, each with tolerances that are linear around itself.

    Around what was found they are bent to what that lacks, so that a law which bends them back, as
    the right one does, seems to leave far more than it does. Not what is hopeless even so, nor what
    hardly bends them. A law that contains what was found is never hopeless: it cannot explain less.

    Args:
        objective: the deciding replays.
        hypothesis: their reference, which it stays.
        now: what was found, as refined around it.
        others: lookalikes in its place.
        index: of that place.
        known: slopes in what stands beside them.
    """
    found, motion = now.hypothesis[index], objective.motion
    bent = [
        _is_bent(f)
        and (
            worth(objective, f, now) > -HOPELESS
            or bool(found.beyond(f.hypothesis[index].effect, motion))
        )
        for f in others
    ]
    if objective.scene.free or not any(bent):  # replays of legs settle as they are refined
        return now, list(others)
    centre = objective.reference(hypothesis).centre
    each = zip(others, bent, strict=True)
    settled = [around_itself(objective, f, now, [index], known) if far else f for f, far in each]
    least = -THRESHOLDS.min_nats
    if _is_bent(now) and any(worth(objective, f, now) > least for f in settled):
        now = around_itself(objective, now, now, [index], known)
    objective.reference(hypothesis, centre, most=1)
    return now, settled


def _is_bent(fit: Assessed) -> bool:
    """Tell whether tolerances adapted far from where they were linear."""
    return bool(np.abs(fit.tolerances - fit.centre).max(initial=0.0) > FAR)


def _best(options: Sequence[Option]) -> Option:
    """The law that is claimed: of those that cannot be told apart, the most usual.

    Args:
        options: the law that was found, then its lookalikes.
    """
    first, lead = options[0], max(o.lead for o in options)
    close = [o for o in options if o.lead > lead - THRESHOLDS.equivalent_nats]
    best = max(close, key=lambda o: (o.usual, o.lead))
    stays = best.usual <= first.usual and best.lead <= THRESHOLDS.evident_nats
    return first if stays else best


def _rivals(options: Sequence[Option], best: Option) -> list[Option]:
    """What recordings cannot tell from the best, the most usual first.

    How rare an effect is decides what is claimed, and tells nothing apart.
    """
    least = best.evidence - THRESHOLDS.equivalent_nats
    close = [o for o in options if o.evidence > least and o.law.key != best.law.key]
    return sorted(close, key=lambda o: (-o.usual, -o.evidence))


def _shape(starts: Sequence[Start], law: Planted) -> Shape | None:
    """The shape of the start that a law was refined from."""
    return next(s for p, s in starts if p.key == law.key and p.effect is law.effect)


def _best_of_each(fits: Iterable[Assessed], index: int, most: int) -> list[Assessed]:
    """The best fits of each law in a place, at most so many of each."""
    count: dict[Key, int] = {}
    best = []
    for fit in sorted(fits, key=lambda f: -f.loglik):
        key = fit.hypothesis[index].key
        count[key] = count.get(key, 0) + 1
        if np.isfinite(fit.loglik) and count[key] <= most:
            best.append(fit)
    return best


def _due(one: Hypothesis, other: Hypothesis) -> float:
    """Lead that one must have over another for being larger [nats]; less than none if smaller."""
    return THRESHOLDS.min_nats * float(np.sign(size(one) - size(other)))
