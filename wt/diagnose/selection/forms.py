"""Which form of a law the recordings show: a simulator has some laws in more than one.

MuJoCo's dry friction, for one, creeps before it slips, the more the softer its constraint. Real
joints hardly do, other simulators as their makers pleased. A form has no parameters of its own and
is no finding: it belongs to how the law is written down.
"""

from __future__ import annotations

from dataclasses import replace

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Effect, forms_of
from wt.physics.planted import Hypothesis


def in_best_form(
    quick: Objective, objective: Objective, accepted: tuple[Accepted, ...], log: DecisionLog
) -> tuple[Accepted, ...]:
    """The same effects, each in its usual form unless replays are clearly likelier in another.

    Args:
        quick: replays of a part of the recordings, which say at once that a form is none.
        objective: replays of all of them, which say that it is one.
        accepted: effects that were found.
        log: grows by what changes.
    """
    present: dict[Objective, Assessed] = {}
    for i in range(len(accepted)):
        for form in _others(accepted[i]):
            now, other = accepted[i], replace(accepted[i].planted, effect=form)
            changed = (*accepted[:i], replace(now, planted=other), *accepted[i + 1 :])
            due = THRESHOLDS.equivalent_nats if form.form else -THRESHOLDS.equivalent_nats
            for replays, least in ((quick, min(due, 0.0)), (objective, due)):
                # each as replays around itself say: what adapts to one does not to the other
                if replays not in present:
                    present[replays] = replays.reference(_laws(accepted))
                after = replays.reference(_laws(changed))
                lead = after.loglik - present[replays].loglik
                if lead <= least:
                    break
            else:
                accepted, present = changed, {objective: after}
                reason = f"as {form.form}" if form.form else "in the usual form"
                log.add(other, "alternative", True, lead, due, reason)
    return accepted


def _laws(accepted: tuple[Accepted, ...]) -> Hypothesis:
    return tuple(a.planted for a in accepted)


def _others(found: Accepted) -> list[Effect]:
    """The forms of a law in which it was not found."""
    effect = found.planted.effect
    return [form for form in forms_of(effect) if form.form != effect.form]
