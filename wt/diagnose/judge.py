"""What of the search stands: names are doubted, gains are proven, and what is left is faced.

A name is kept if a force of any other shape at its joint does not predict much better, and if it
improves the fit of held-out recordings. What then remains, and improves the held-out fit when it
is learned, is said to be unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose import proof
from wt.diagnose.addition import Accepted
from wt.diagnose.assessed import Hypothesis, without
from wt.diagnose.calibrate import calibration, comments
from wt.diagnose.crossfit import where_mute
from wt.diagnose.estimate import Estimated, estimate, least_certain
from wt.diagnose.lookalikes import Lookalikes
from wt.diagnose.objective import Objective
from wt.diagnose.remainder import Unknown, find
from wt.diagnose.result import Confusable, Finding, Verdict
from wt.diagnose.rivals import DOUBTFUL, rivals_nonparametric
from wt.diagnose.screen import Screen
from wt.diagnose.simplify import simplified
from wt.diagnose.unforeseen import erring
from wt.diagnose.worth import erring_joints
from wt.physics.planted import Key, Planted

Array = np.ndarray

MOST_UNKNOWN = 2


@dataclass(frozen=True, eq=False)
class Judged:
    """What stands.

    Attributes:
        accepted: named effects.
        estimated: their parameters.
        gains: what each is worth on held-out data.
        unknown: what no known effect explains.
        corrections: of what any rig is off by, beside the findings.
    """

    accepted: tuple[Accepted, ...]
    estimated: Estimated
    gains: tuple[proof.Gain, ...]
    unknown: tuple[Unknown, ...]
    corrections: Hypothesis = ()

    def unexplained(self, objective: Objective) -> dict[str, float]:
        """Where nothing was found and still replays err by much: joint → share of it."""
        if self.accepted or self.unknown:
            return {}
        return erring(self.estimated.assessed, objective)

    @property
    def patch(self) -> Hypothesis:
        """What is written into the model: named effects and corrections."""
        return (*self.estimated.hypothesis, *self.corrections)

    @property
    def comments(self) -> list[str]:
        """A sentence for each part of :attr:`patch`."""
        named = [p.statement for p in self.estimated.hypothesis]
        return named + comments(self.corrections)

    @property
    def complete(self) -> Hypothesis:
        """Findings and corrections."""
        return (*self.hypothesis, *self.corrections)

    @property
    def hypothesis(self) -> Hypothesis:
        """All effects that were found, named ones first."""
        return (*self.estimated.hypothesis, *(u.planted for u in self.unknown))

    @property
    def shares(self) -> list[float]:
        """Held-out share of each effect of :attr:`hypothesis`."""
        return [g.share for g in self.gains] + [u.gain.share for u in self.unknown]


@dataclass(frozen=True, eq=False)
class Court:
    """What is needed to judge.

    Attributes:
        screen: the force residual.
        some: replays that the search compared hypotheses by.
        objective: replays of all fitted data.
        whole: makes replays of these and of the held-out recordings, once it is asked.
        held: held-out recordings.
        step: physics step of replays [s].
        seed: of everything random.
    """

    screen: Screen
    some: Objective
    objective: Objective
    whole: Callable[[], Objective]
    held: proof.Held
    step: float
    seed: int

    def judge(self, proven: Judged) -> Judged:
        """Doubt names, look at what is left, and correct what any rig is off by."""
        judged = self._doubted(proven)
        found = calibration(self.objective, self.held, judged.hypothesis, self.step)
        return replace(judged, corrections=found)

    def _doubted(self, proven: Judged) -> Judged:
        named = self._with_unknown(proven)
        doubtful = [i for i in range(len(proven.accepted)) if self._doubtful(proven, i)]
        if not doubtful:
            return named
        rest = tuple(a for i, a in enumerate(proven.accepted) if i not in doubtful)
        unnamed = self._with_unknown(self.proven(rest))
        return unnamed if self._better(unnamed, named) else named

    def proven(
        self, accepted: tuple[Accepted, ...], attempts: int = 1, known: Container[Key] = ()
    ) -> Judged:
        """Only what is certain and improves the held-out fit stays, estimated without the rest.

        Args:
            accepted: what the search found.
            attempts: how often held-out data have been asked; all that is asked has to be paid.
            known: effects that were compared with their lookalikes before.
        """
        estimated = estimate(self.objective, tuple(a.planted for a in accepted))
        alike = Lookalikes(self.screen, self.some, self.objective, self.whole)
        accepted, estimated = alike.settled(accepted, estimated, known)
        accepted, estimated = simplified(self.objective, accepted, estimated)
        while accepted:
            weakest = least_certain(estimated)
            if weakest is None:
                gains = self._gains(estimated)
                weakest = int(np.argmax([g.p_value for g in gains]))
                if gains[weakest].p_value <= proof.SIGNIFICANT / attempts:
                    return Judged(accepted, estimated, tuple(gains), ())
            accepted = tuple(a for i, a in enumerate(accepted) if i != weakest)
            estimated = estimate(self.objective, without(estimated.hypothesis, weakest))
        return Judged((), estimated, (), ())

    def _gains(self, estimated: Estimated) -> list[proof.Gain]:
        """Gain of each effect: all of them against all but this one.

        On held-out data, or on the fitted ones where those cannot say; either kind of test pays
        for how many there are of it.
        """
        whole, objective = estimated.assessed, self.objective
        all_but_one = [without(whole.hypothesis, i) for i in range(len(whole.hypothesis))]
        sides = [whole, *objective.evaluate(all_but_one)]
        # what the rig is off by is known from replays that leave nothing else to explain
        known = not erring_joints(objective, whole)
        full, *lesser = [
            (*s.hypothesis, *(objective.calibration(s) if known else ())) for s in sides
        ]
        gains = proof.gains(self.held, full, lesser, self.step)
        return where_mute(objective, self.held, whole.hypothesis, full, gains, self.step)

    def clean(self, judged: Judged) -> bool:
        """Whether nothing but noise is left of the fitted recordings."""
        return not erring_joints(self.objective, judged.estimated.assessed)

    def _with_unknown(self, judged: Judged) -> Judged:
        """Learn what is left, as long as that improves the held-out fit."""
        if self.clean(judged):
            return judged
        found: list[Unknown] = []
        assessed = judged.estimated.assessed
        while len(found) < MOST_UNKNOWN:
            unknown = find(
                self.screen, self.objective, assessed, self.held, step=self.step, seed=self.seed
            )
            if unknown is None or any(unknown.planted.at == u.planted.at for u in found):
                break
            found.append(unknown)
            assessed = self.objective.reference((*assessed.hypothesis, unknown.planted))
        return Judged(judged.accepted, judged.estimated, judged.gains, tuple(found))

    def _doubtful(self, judged: Judged, index: int) -> bool:
        rivalry = rivals_nonparametric(self.screen, judged.hypothesis, index, seed=self.seed)
        return rivalry is not None and rivalry.ratio < DOUBTFUL

    def _better(self, one: Judged, other: Judged) -> bool:
        """Whether the held-out fit is better."""
        if not one.unknown:
            return False
        return proof.gain(self.held, one.hypothesis, other.hypothesis, self.step).share > 0.0


def verdict(judged: Judged, objective: Objective, others: Sequence[Finding] = ()) -> Verdict:
    """In one word, by what the findings leave in replays, in units of noise.

    Args:
        judged: what stands.
        objective: replays of all fitted data.
        others: findings that replays do not show.
    """
    if judged.unknown:
        return "partly_explained" if judged.accepted else "unexplained"
    if not judged.accepted:
        if judged.unexplained(objective):
            return "unexplained"
        return "explained" if others else "no_mismatch"
    left = erring_joints(objective, judged.estimated.assessed)
    return "partly_explained" if left else "explained"


def findings(judged: Judged) -> tuple[Finding, ...]:
    """For people, the most important first."""
    found = [
        Finding(
            effect=planted.effect.id,
            at=planted.at,
            parameters=values,
            statement=planted.statement,
            holdout_gain=gain.share,
            p_value=gain.p_value,
            confusable_with=tuple(_confusable(planted, r) for r in a.rivals),
            reference=planted.effect.reference,
        )
        for a, planted, values, gain in zip(
            judged.accepted,
            judged.estimated.hypothesis,
            judged.estimated.estimates,
            judged.gains,
            strict=True,
        )
    ]
    found += [
        Finding(
            effect="unknown",
            at=u.planted.at,
            parameters={},
            statement=u.statement,
            holdout_gain=u.gain.share,
            p_value=u.gain.p_value,
            depends_on=u.depends_on,
            formula=u.formula,
        )
        for u in judged.unknown
    ]
    return tuple(sorted(found, key=lambda f: -f.holdout_gain))


def suggestions(found: Sequence[Finding]) -> tuple[str, ...]:
    """What to record next, so that what was confused can be told apart."""
    experiments = [c.separating_experiment for f in found for c in f.confusable_with]
    return tuple(dict.fromkeys(experiments))


def _confusable(found: Planted, rival: Planted) -> Confusable:
    return Confusable(rival.effect.id, rival.at, found.effect.separation(found.at))
