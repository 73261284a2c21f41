"""Which form of a law the recordings show: a simulator has some laws in more than one.

MuJoCo's dry friction, for one, creeps before it slips, the more the softer its constraint. Real
joints hardly do, other simulators as their makers pleased. A form has no parameters of its own and
is no finding: it belongs to how the law is written down.
"""

from __future__ import annotations

from dataclasses import replace

from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS


def in_best_form(
    objective: Objective, accepted: tuple[Accepted, ...], log: DecisionLog
) -> tuple[Accepted, ...]:
    """The same effects, each in the form by which replays are clearly the likeliest.

    Args:
        objective: replays.
        accepted: effects that were found.
        log: grows by what changes.
    """
    if any(a.planted.effect.forms for a in accepted):
        objective.reference(tuple(a.planted for a in accepted))
    for i, found in enumerate(accepted):
        for form in found.planted.effect.forms:
            planted = replace(found.planted, effect=form)
            changed = tuple(
                replace(a, planted=planted) if k == i else a for k, a in enumerate(accepted)
            )
            before, after = objective.evaluate(
                [tuple(a.planted for a in those) for those in (accepted, changed)]
            )
            lead = after.loglik - before.loglik
            if lead > THRESHOLDS.equivalent_nats:
                accepted = changed
                reason = f"as {form.form}"
                log.add(planted, "alternative", True, lead, THRESHOLDS.equivalent_nats, reason)
    return accepted
