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
from wt.physics.effect import Effect, effects
from wt.physics.planted import Hypothesis


def in_best_form(
    objective: Objective, accepted: tuple[Accepted, ...], log: DecisionLog
) -> tuple[Accepted, ...]:
    """The same effects, each in its usual form unless replays are clearly likelier in another.

    Args:
        objective: replays.
        accepted: effects that were found.
        log: grows by what changes.
    """
    before: Assessed | None = None
    for i in range(len(accepted)):
        for form in _others(accepted[i]):
            now, other = accepted[i], replace(accepted[i].planted, effect=form)
            changed = (*accepted[:i], replace(now, planted=other), *accepted[i + 1 :])
            # each as replays around itself say: what adapts to one is not what adapts to the other
            before = before or objective.reference(_laws(accepted))
            after = objective.reference(_laws(changed))
            lead = after.loglik - before.loglik
            due = THRESHOLDS.equivalent_nats if form.form else -THRESHOLDS.equivalent_nats
            if lead > due:
                accepted, before = changed, after
                reason = f"as {form.form}" if form.form else "in the usual form"
                log.add(other, "alternative", True, lead, due, reason)
    return accepted


def _laws(accepted: tuple[Accepted, ...]) -> Hypothesis:
    return tuple(a.planted for a in accepted)


def _others(found: Accepted) -> list[Effect]:
    """The forms of a law in which it was not found."""
    found_as = found.planted.effect
    usual = effects().get(found_as.id, found_as)  # a learned law has one
    family = (usual, *usual.forms) if usual.forms else ()
    return [form for form in family if form.form != found_as.form]
