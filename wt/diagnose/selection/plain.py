"""Laws of a joint's position alone, against a plain curve of it with as many figures.

A wave of which little more than one is seen bends once up and once down, as a stiffening buffer and
a spring do together: that it comes again is not seen. And laws of one joint's position that all but
cancel (x − sin x is a cubic) are a curve in disguise: nothing is as large as each of them. So these
are claimed only where a curve that does not come again, and may be chosen as freely, predicts
held-out data significantly worse; other laws of one position only where it is not clearly better.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.bic import size
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.residual.screen import Screen
from wt.diagnose.residual.signature import force
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import Holdout, lead_with_tolerances
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.force import Unknown, of_law
from wt.diagnose.unknown.law import Law
from wt.diagnose.unknown.smooth import SmoothForce, smooth_force
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location

_STEPS = 3  # that the curve is refined by
_DEGREE, _ALL = 12, 1e-4
"""A force is one of the position if a polynomial of such a degree leaves this of its square."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Plain curves that would do in the place of named effects.

    Attributes:
        replaced: indices of these.
        laws: joint → its curve.
    """

    replaced: Container[int]
    laws: Mapping[str, Law]

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self.laws)

    def learned(
        self, screen: Screen, rest: Hypothesis, holdout: Holdout, step: float, seed: int
    ) -> list[Unknown]:
        """Each as something unknown, beside the effects that stay; see :func:`of_law`."""
        return [
            of_law(screen, law, joint, rest, holdout, step=step, seed=seed)
            for joint, law in self.laws.items()
        ]


NO_CURVES = Curves((), {})


def curves_in_disguise(
    objective: Objective, holdout: Holdout, hypothesis: Hypothesis, step: float, log: DecisionLog
) -> Curves:
    """Curves of a joint's position that do as well as what was named there.

    Args:
        objective: replays of the fitted recordings.
        holdout: recordings that decide.
        hypothesis: effects, as estimated.
        step: physics step of replays [s].
        log: grows by every decision.
    """
    given_up, laws = set[int](), dict[str, Law]()
    motion = objective.motion
    for joint in motion.scene.own_joints:
        mine = _of_position(motion, hypothesis, joint)
        forces = [_own(motion, hypothesis[i], joint) for i in mine]
        far_fetched = any(hypothesis[i].effect.comes_again for i in mine) or _cancel(forces)
        if not far_fetched and len(mine) < 2:
            continue
        curve = _instead(objective, hypothesis, mine, joint)
        pair = (hypothesis, curve) if far_fetched else (curve, hypothesis)
        lead = lead_with_tolerances(objective, holdout, *pair, step)
        if far_fetched:
            stays = lead.p_value <= THRESHOLDS.significant
        else:
            better = lead.p_value <= THRESHOLDS.significant
            stays = not (better and lead.share >= THRESHOLDS.unknown_share)
        reason = f"a curve of qpos/{joint} with as many figures predicts "
        reason += "worse" if far_fetched and stays else "no better" if stays else "as well"
        for i in mine:
            log.add(hypothesis[i], "doubted", stays, lead.p_value, THRESHOLDS.significant, reason)
        if not stays:
            given_up |= set(mine)
            laws[joint] = _law(curve[-1])
    return Curves(given_up, laws)


def _of_position(motion: Motion, hypothesis: Hypothesis, joint: str) -> list[int]:
    """Effects whose force is on one joint alone, and a function of its position."""
    dof = motion.scene.dof(joint)
    q = motion.q[:, dof]
    x = 2.0 * (q - q.min()) / max(float(np.ptp(q)), 1e-12) - 1.0
    table = np.polynomial.chebyshev.chebvander(x, _DEGREE)

    def depends(planted: Planted) -> bool:
        acts = force(motion, planted)
        if acts is None:
            return False
        total, own = float(np.sum(acts**2)), acts[:, dof]
        best, *_ = np.linalg.lstsq(table, own, rcond=None)
        left = total - float(np.sum(own**2)) + float(np.sum((own - table @ best) ** 2))
        return total > 0.0 and left < _ALL * total

    return [i for i, p in enumerate(hypothesis) if depends(p)]


def _instead(
    objective: Objective, hypothesis: Hypothesis, mine: Sequence[int], joint: str
) -> Hypothesis:
    """The hypothesis with a curve in the place of some effects, refined by replays."""
    motion, replaced = objective.motion, tuple(hypothesis[i] for i in mine)
    effect, at = smooth_force(motion, joint, size(replaced)), Location("joint", joint)
    dof = motion.scene.dof(joint)
    total = np.sum([_own(motion, p, joint) for p in replaced], axis=0)
    curves = effect.columns(motion, at, ())[:, dof]
    theta, *_ = np.linalg.lstsq(curves, total, rcond=None)
    rest = tuple(p for i, p in enumerate(hypothesis) if i not in mine)
    parts = (*rest, Planted(effect, at, theta))
    now = objective.reference(parts)
    (now,) = refine(objective, [now.hypothesis], [range(len(parts))], _STEPS)
    return now.hypothesis


def _law(planted: Planted) -> Law:
    assert isinstance(planted.effect, SmoothForce)
    return planted.effect.summed(planted.theta)


def _own(motion: Motion, planted: Planted, joint: str) -> Float[np.ndarray, " sample"]:
    """Force of an effect on one joint along a motion."""
    acts = force(motion, planted)
    return np.zeros(len(motion)) if acts is None else acts[:, motion.scene.dof(joint)]


def _cancel(forces: Sequence[Float[np.ndarray, " sample"]]) -> bool:
    """Tell whether some forces leave far less together than the largest of them is."""
    if len(forces) < 2:
        return False
    return bool(
        np.std(np.sum(forces, axis=0)) < THRESHOLDS.cancelled * np.std(forces, axis=1).max()
    )
