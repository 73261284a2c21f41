"""Small corrections of the model beside its findings: masses, damping, gains, rotor inertia.

Every rig is off by a few per cent, which is no finding. Where a finding changes the model anyway
and the recordings show these errors, correcting them makes the patched model fit down to the
noise; it has to be proven on held-out data like everything else.
"""

from __future__ import annotations

from wt.diagnose import proof
from wt.diagnose.assessed import Hypothesis
from wt.diagnose.objective import Objective


def calibration(
    objective: Objective, held: proof.Held, hypothesis: Hypothesis, step: float
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
    gain = proof.gain(held, (*hypothesis, *found), hypothesis, step)
    return found if gain.p_value <= proof.SIGNIFICANT else ()


def comments(corrections: Hypothesis) -> list[str]:
    """What stands beside the corrections in the patched model."""
    return [
        f"Within tolerance, no finding: {p.effect.id} of {p.at}, "
        + ", ".join(f"{name} {value:.4g}" for name, value in p.effect.named(p.theta).items())
        for p in corrections
    ]
