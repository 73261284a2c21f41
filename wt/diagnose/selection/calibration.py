"""Corrections within a model's tolerances, beside findings.

Every model is off by a few per cent, which is no finding. Where a finding changes the model anyway
and the recordings show these tolerances, they are corrected, so that the patched model fits down to
the noise; that has to be proven on held-out data like everything else.
"""

from __future__ import annotations

from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import Holdout, gain
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis


def calibration(
    objective: Objective,
    holdout: Holdout,
    hypothesis: Hypothesis,
    step: float,
    log: DecisionLog,
) -> Hypothesis:
    """Corrections within the model's tolerances; none unless all together are proven.

    Args:
        objective: replays of all fitted data.
        holdout: held-out recordings.
        hypothesis: the findings; without any, nothing is corrected.
        step: physics step of replays [s].
        log: grows by every decision.
    """
    if not hypothesis:
        return ()
    corrections = objective.calibration(objective.reference(hypothesis))
    gained = gain(holdout, (*hypothesis, *corrections), hypothesis, step)
    kept = gained.p_value <= THRESHOLDS.significant
    reason = "within tolerance, no finding"
    for planted in corrections:
        log.add(planted, "calibrated", kept, gained.p_value, THRESHOLDS.significant, reason)
    return corrections if kept else ()


def comments(corrections: Hypothesis) -> list[str]:
    """Comments beside the corrections in the patched model."""
    return [
        f"Within tolerance, no finding: {p.effect.id} of {p.at}, "
        + ", ".join(f"{name} {value:.4g}" for name, value in p.effect.named(p.theta).items())
        for p in corrections
    ]
