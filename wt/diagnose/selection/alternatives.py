"""Alternatives to a law that was found: its lookalikes, and the simpler law that it contains.

*Lookalikes.* The search compares many hypotheses on a part of the data, most of them hardly
refined. A joint under a load of one sign, say, is pushed aside by a constant, and it takes every
motion recorded to tell a drive's dead band from its bias, from play in the gear or from an
encoder's zero. So each effect that was found is compared once more with its lookalikes, all of them
refined, on all recordings, the held-out ones among them. That decides which of them it is. Whether
there is one, and how large it is, remain to be proven and estimated.

*Simpler laws.* The larger of two laws may fit better for a reason that is not its own: it moves
through standstill in another way, say. Where the simpler law lies inside the intervals of the
larger one, the simpler one is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose.likelihood.bic import erring_joints, price, room, size, worth
from wt.diagnose.likelihood.estimate import Estimated, estimate
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.candidates import excluded, near
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Shape, alternatives, effects
from wt.physics.hooks import shaped
from wt.physics.planted import Hypothesis, Key, Planted, without

Start = tuple[Planted, Shape | None]
"""Parameters to start from, and the shape of the signature if there is one."""

_STARTS, _STEPS = 2, 2
"""So many starts of each lookalike get so many steps, then the best, then that on all data, …"""
_FAR, _HOPELESS = 120.0, 30.0
"""… unless they are so many nats worse than what was found before the second and the third."""


@dataclass(frozen=True, eq=False)
class Lookalikes:
    """Comparison of an effect with its lookalikes.

    Attributes:
        screen: the force residual, for where they start.
        search_replays: replays of a part of the fitted data, for their first steps.
        objective: replays of all of them.
        all_replays: makes replays of these and of the held-out recordings, once it is asked.
        log: grows by every decision.
    """

    screen: Screen
    search_replays: Objective
    objective: Objective
    all_replays: Callable[[], Objective]
    log: DecisionLog

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
            ahead, best = max(options, key=lambda option: option[0])
            law = best[i]
            self._log(now.planted, i, options)
            if ahead > THRESHOLDS.evident_nats:
                now = Accepted(law, _shape(starts, law), ())
                parts = (*present.hypothesis[:i], law, *present.hypothesis[i + 1 :])
                (present,) = refine(self.objective, [parts], [range(len(parts))], 1)
            close = [h[i] for x, h in options if x > ahead - THRESHOLDS.equivalent_nats]
            rivals = tuple(p for p in close if p.key != now.planted.key)
            now = replace(now, rivals=rivals)
            accepted = (*accepted[:i], now, *accepted[i + 1 :])
        if present is not estimated.assessed:
            estimated = estimate(self.objective, present.hypothesis)
        return accepted, estimated

    def _log(
        self, planted: Planted, index: int, options: Sequence[tuple[float, Hypothesis]]
    ) -> None:
        """Log the lookalikes of an effect; ``options`` as in :meth:`_compared`, itself first."""
        ahead, best = max(options, key=lambda option: option[0])
        given_up = ahead > THRESHOLDS.evident_nats
        for lead, hypothesis in options:
            law, won = hypothesis[index], hypothesis is best and given_up
            if law is planted or hypothesis is options[0][1]:
                kept, reason = not given_up, "no law that looks alike is more likely"
                if given_up:
                    reason = f"gives way to {best[index]}, {ahead:.3g} nats ahead on all recordings"
                lead = ahead
            else:
                kept, reason = won, f"takes the place of {planted}" if won else f"not {planted}"
            self.log.add(law, "alternative", kept, lead, THRESHOLDS.evident_nats, reason)

    def _starts(self, accepted: Sequence[Accepted], now: Assessed, index: int) -> list[Start]:
        """Lookalikes of an effect at its place or close to it, each from where it may start."""
        hypothesis, rivals = now.hypothesis, accepted[index].rivals
        found, rest = hypothesis[index], without(hypothesis, index)
        motion = self.screen.motion
        wanted = {
            (name, at)
            for name in alternatives(found.effect.id)
            for at in near(self.screen, found.at)
        } | {(r.effect.id, r.at) for r in rivals}
        known = [(p, a.shape) for p, a in zip(hypothesis, accepted, strict=True) if p is not found]
        ranked = [s for s in self.screen.rank(known, wanted) if np.isfinite(s.gain)]
        shapes: dict[Key, Shape | None] = {s.planted.key: s.shape for s in ranked}
        plain = [*(s.planted for s in ranked), *rivals]
        larger: list[Start] = []
        for name, at in sorted(wanted, key=str):
            effect = effects()[name]
            if at in effect.places(motion.scene):
                here = [] if effect.shapes(motion, at) else effect.starts(motion, at)
                plain += [Planted(effect, at, theta) for theta in here]
                if at == found.at:
                    further = found.beyond(effect, motion)
                    larger += [(Planted(shaped(effect, s), at, theta), s) for s, theta in further]
        starts = [*((p, shapes.get(p.key)) for p in plain), *larger]
        possible = [
            (p, shape)
            for p, shape in starts
            if p.key != found.key and not any(p.key == r.key or excluded(p, r) for r in rest)
        ]
        # no fit is better than one that leaves nothing but noise: a larger law may not earn its due
        left, paid = room(self.objective, now), price(self.objective, (found,))
        return [
            (p, shape)
            for p, shape in possible
            if not (due := _due((p,), (found,))) or price(self.objective, (p,)) - paid + due < left
        ]

    def _compared(
        self, hypothesis: Hypothesis, index: int, starts: Sequence[Planted]
    ) -> list[tuple[float, Hypothesis]]:
        """Lookalikes in the place of an effect, and it: how many nats each is ahead of it."""
        present = self.search_replays.reference(hypothesis)
        tried = [(*hypothesis[:index], p, *hypothesis[index + 1 :]) for p in starts]
        begun = _best_of_each(self.search_replays.evaluate(tried), index, _STARTS)
        for _ in range(2):
            fits = refine(
                self.search_replays, [f.hypothesis for f in begun], [[index]] * len(begun), _STEPS
            )
            near_it = [f for f in fits if f.loglik > present.loglik - _FAR]
            begun = _best_of_each(near_it, index, 1)
        going = [f.hypothesis for f in begun if worth(self.search_replays, f, present) > -_HOPELESS]
        if not going:
            return [(0.0, hypothesis)]
        events = any(p.observed() for p in hypothesis)  # at other times in other recordings
        judge = self.objective if events else self.all_replays()
        judge.reference(hypothesis)
        everything = [range(len(hypothesis))] * (len(going) + 1)
        now, *others = refine(judge, [hypothesis, *going], everything, _STEPS)
        ahead = [worth(judge, f, now) - _due(f.hypothesis, hypothesis) for f in others]
        return [
            (0.0, hypothesis),
            *((x, f.hypothesis) for x, f in zip(ahead, others, strict=True)),
        ]


def _shape(starts: Sequence[Start], law: Planted) -> Shape | None:
    """The shape of the start that a law was refined from."""
    return next(s for p, s in starts if p.key == law.key and p.effect is law.effect)


def _best_of_each(fits: Iterable[Assessed], index: int, most: int) -> list[Assessed]:
    """The best fits of each law in a place, at most so many of each."""
    count: dict[Key, int] = {}
    found = []
    for fit in sorted(fits, key=lambda f: -f.loglik):
        key = fit.hypothesis[index].key
        count[key] = count.get(key, 0) + 1
        if np.isfinite(fit.loglik) and count[key] <= most:
            found.append(fit)
    return found


def _due(one: Hypothesis, other: Hypothesis) -> float:
    """Lead that one must have over another for being larger [nats]."""
    return THRESHOLDS.min_nats if size(one) > size(other) else 0.0


def simplified(
    objective: Objective,
    accepted: tuple[Accepted, ...],
    estimated: Estimated,
    log: DecisionLog,
) -> tuple[tuple[Accepted, ...], Estimated]:
    """The same effects by the simplest laws that leave no more to explain.

    Args:
        objective: replays of the fitted recordings.
        accepted: effects.
        estimated: their parameters.
        log: grows by every decision.
    """
    for i, planted in enumerate(estimated.hypothesis):
        intervals = {name: e.ci95 for name, e in estimated.estimates[i].items()}
        found = planted.simpler(objective.motion, intervals)
        if found is None:
            continue
        law = Planted(effects()[found[0]], planted.at, found[1])
        others = tuple(law if k == i else p for k, p in enumerate(estimated.hypothesis))
        again = estimate(objective, others)
        before, after = (erring_joints(objective, e.assessed) for e in (estimated, again))
        simple_enough, sizes = set(after) <= set(before), (planted.effect.n_free, law.effect.n_free)
        reason = f"its further parameters are not needed: {law}" if simple_enough else "needed"
        log.add(planted, "simplified", not simple_enough, float(sizes[0]), float(sizes[1]), reason)
        if simple_enough:
            now = _by(law, accepted[i], objective)
            accepted = (*accepted[:i], now, *accepted[i + 1 :])
            estimated = again
    return accepted, estimated


def _by(law: Planted, before: Accepted, objective: Objective) -> Accepted:
    """An effect by another law, which is no rival of itself."""
    return Accepted(
        planted=law,
        shape=next(iter(law.effect.shapes(objective.motion, law.at)), None),
        rivals=tuple(r for r in before.rivals if r.key != law.key),
    )
