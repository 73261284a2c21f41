"""Naming: which effects of the search are claimed, which are doubted, and what is left unknown.

A name is kept if it improves the fit of held-out recordings, and if no nonparametric force at its
joint predicts much better: a law of the library always fits something, and is the right one only if
a regression of any shape on positions, velocities and time, which must predict blocks of time that
it has not seen, cannot beat it by much (:func:`rivals_nonparametric`). What then remains, and
improves the held-out fit when it is learned, is reported as unknown.

Every model is off by a few per cent, which is no finding. Where a finding changes the model anyway
and the recordings show these tolerances, :func:`calibration` corrects them, so that the patched
model fits down to the noise; that has to be proven on held-out data like everything else.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose.likelihood.bic import erring, erring_joints
from wt.diagnose.likelihood.estimate import Estimated, estimate, least_certain
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.residual.scoring import STRIDE, WINDOW
from wt.diagnose.residual.screen import Screen, leftover
from wt.diagnose.residual.signature import signature
from wt.diagnose.selection.alternatives import Lookalikes, simplified
from wt.diagnose.selection.holdout import Gain, Holdout, gain, gains, where_mute
from wt.diagnose.selection.search import Accepted
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.choice import freest
from wt.diagnose.unknown.fit import Data
from wt.diagnose.unknown.force import Unknown, find
from wt.diagnose.unknown.memory import recorded
from wt.physics.planted import Hypothesis, Key, without
from wt.physics.scene import Scene
from wt.types import Location

Array = np.ndarray


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
    gains: tuple[Gain, ...]
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
    held: Holdout
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
                if gains[weakest].p_value <= THRESHOLDS.significant / attempts:
                    return Judged(accepted, estimated, tuple(gains), ())
            accepted = tuple(a for i, a in enumerate(accepted) if i != weakest)
            estimated = estimate(self.objective, without(estimated.hypothesis, weakest))
        return Judged((), estimated, (), ())

    def _gains(self, estimated: Estimated) -> list[Gain]:
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
        each = gains(self.held, full, lesser, self.step)
        return where_mute(objective, self.held, whole.hypothesis, full, each, self.step)

    def clean(self, judged: Judged) -> bool:
        """Whether nothing but noise is left of the fitted recordings."""
        return not erring_joints(self.objective, judged.estimated.assessed)

    def _with_unknown(self, judged: Judged) -> Judged:
        """Learn what is left, as long as that improves the held-out fit."""
        if self.clean(judged):
            return judged
        found: list[Unknown] = []
        assessed = judged.estimated.assessed
        while len(found) < THRESHOLDS.most_unknown:
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
        return rivalry is not None and rivalry.ratio < THRESHOLDS.doubtful

    def _better(self, one: Judged, other: Judged) -> bool:
        """Whether the held-out fit is better."""
        if not one.unknown:
            return False
        return gain(self.held, one.hypothesis, other.hypothesis, self.step).share > 0.0


@dataclass(frozen=True)
class Rivalry:
    """A named effect against a nonparametric force of the same joint.

    Attributes:
        ratio: mean square of what the nonparametric force leaves when it predicts blocks it has
            not seen, over what the named effect leaves; both at least the noise floor's. 1 if the
            named effect leaves only noise.
        nats: log-likelihood by which the nonparametric force is ahead.
        r2: share of the joint's force that the named effect explains.
        depends_on: columns of the nonparametric force.
    """

    ratio: float
    nats: float
    r2: float
    depends_on: tuple[str, ...]


def rivals_nonparametric(
    screen: Screen, hypothesis: Hypothesis, index: int, *, seed: int = 0, step: float = 1e-3
) -> Rivalry | None:
    """Compare one effect of a hypothesis with a force of any shape at its joint.

    Args:
        screen: the fitted recordings.
        hypothesis: the accepted effects.
        index: which of them.
        seed: of the folds.
        step: coarsest physics step of replays [s].

    Returns:
        None where the comparison says nothing: the effect is not at one joint, or has no
        signature in forces (gear play, elasticity, sensors).
    """
    planted = hypothesis[index]
    joint = _joint(screen.motion.scene, planted.at)
    if joint is None or signature(screen.motion, planted) is None:
        return None
    dof = screen.motion.scene.dof(joint)
    rest = leftover(screen, hypothesis)
    rows = rest.keep[:, dof]
    data = Data(screen, joint, rest.without(index)[:, dof], rows, seed, step)
    fit, _ = freest(data)
    count, floor = len(data.force), float(screen.floor[dof]) ** 2
    named = max(float(np.mean(rest.left[rows, dof] ** 2)), floor)
    free = max(float(fit.error.sum()) / count, floor)
    total = max(float(np.mean(data.force**2)), floor)
    nats = 0.5 * count * STRIDE / WINDOW * float(np.log(named / free))
    return Rivalry(free / named, nats, 1.0 - named / total, recorded(fit.names))


def _joint(scene: Scene, at: Location) -> str | None:
    """The one joint that a place acts on."""
    if at.kind == "joint":
        return at.name
    if at.kind == "actuator":
        return scene.drive(at.name).joint
    return None


def calibration(
    objective: Objective, held: Holdout, hypothesis: Hypothesis, step: float
) -> Hypothesis:
    """Corrections inside the box of what any rig is off by; none unless all together are proven.

    Args:
        objective: replays of all fitted data.
        held: held-out recordings.
        hypothesis: the findings; without any, nothing is corrected.
        step: physics step of replays [s].
    """
    if not hypothesis:
        return ()
    found = objective.calibration(objective.reference(hypothesis))
    gained = gain(held, (*hypothesis, *found), hypothesis, step)
    return found if gained.p_value <= THRESHOLDS.significant else ()


def comments(corrections: Hypothesis) -> list[str]:
    """What stands beside the corrections in the patched model."""
    return [
        f"Within tolerance, no finding: {p.effect.id} of {p.at}, "
        + ", ".join(f"{name} {value:.4g}" for name, value in p.effect.named(p.theta).items())
        for p in corrections
    ]
