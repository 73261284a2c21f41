"""The simpler laws that say as much as what was found.

The larger of two laws may fit better for a reason that is not its own: it moves through standstill
in another way, say. Where the simpler law lies inside the intervals of the larger one, the simpler
one is reported. And where one effect says what several of a place do together, as a load does of
mass and centre of mass, that one is.
"""

from __future__ import annotations

from collections.abc import Sequence

from wt.diagnose.likelihood.bic import erring_joints, worth
from wt.diagnose.likelihood.estimate import Estimated, estimate, fitted
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.candidates import excluded
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.hooks import Uniting
from wt.physics.planted import Hypothesis, Planted, without
from wt.types import Location


def by_what_they_became(
    objective: Objective, accepted: list[Accepted], hypothesis: Hypothesis, log: DecisionLog
) -> tuple[list[Accepted], Hypothesis]:
    """Effects by the simpler laws that some have become beside the later ones.

    Friction that seemed to differ with the direction is the same both ways once a weak drive or a
    wrong inertia is known, and its joint is not without any.

    Args:
        objective: replays of the fitted recordings.
        accepted: effects, in the order of the hypothesis.
        hypothesis: the same with their present parameters.
        log: grows by every decision.

    Returns:
        (effects; hypothesis to be refined), the very same where none has become another.
    """
    parts, instead = list(hypothesis), list(accepted)
    became = [(p, law) for p in hypothesis if (law := p.become(objective.motion))]
    for p, law in became:
        i = parts.index(p)
        said = _said(law, without(tuple(parts), i))
        _note(log, p, law, said, False, "it has become")
        parts[i : i + 1] = [] if said else [law]
        instead[i : i + 1] = [] if said else [_accepted(law, objective)]
    return (instead, tuple(parts)) if became else (accepted, hypothesis)


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
    now = estimated.assessed
    for planted, estimates in zip(estimated.hypothesis, estimated.estimates, strict=True):
        i = next(k for k, p in enumerate(now.hypothesis) if p.key == planted.key)
        present, rest = now.hypothesis[i], without(now.hypothesis, i)
        intervals = {name: e.ci95 for name, e in estimates.items()}
        law = present.simpler(objective.motion, intervals)
        if law is None:
            continue
        said = _said(law, rest)
        again = fitted(objective, rest if said else (*rest[:i], law, *rest[i:]), now.hypothesis)
        erring = erring_joints(objective, again)
        # legs err now by more and now by less than their noise: there only nats tell what is lost
        lost = -worth(objective, again, now)
        clean = (again.mse[erring] <= (1.0 + THRESHOLDS.material) * now.mse[erring]).all()
        simple_enough = lost < THRESHOLDS.min_nats or (not said and clean)
        why = "its further parameters are not needed:"
        _note(log, present, law, said, not simple_enough, why)
        if simple_enough:
            # the law is no rival of itself; the larger one may still be it
            others = (r for r in accepted[i].rivals if r.key not in (law.key, present.key))
            larger = (present,) if present.key != law.key else ()
            instead = () if said else (_accepted(law, objective, (*larger, *others)),)
            accepted, now = (*accepted[:i], *instead, *accepted[i + 1 :]), again
    if now is not estimated.assessed:
        estimated = estimate(objective, now.hypothesis, estimated.hypothesis)
    return accepted, estimated


def united(
    objective: Objective,
    accepted: tuple[Accepted, ...],
    estimated: Estimated,
    log: DecisionLog,
) -> tuple[tuple[Accepted, ...], Estimated]:
    """The same effects, several at or near a place by the one that says them all, if there is one.

    Args:
        objective: replays of the fitted recordings.
        accepted: effects.
        estimated: their parameters.
        log: grows by every decision.
    """
    for effect in (e for e in effects().values() if isinstance(e, Uniting)):
        for at in dict.fromkeys(a.planted.at for a in accepted):
            if at.kind == effect.kind:
                accepted, estimated = _united_at(effect, at, objective, accepted, estimated, log)
    return accepted, estimated


def _united_at(
    effect: Uniting,
    at: Location,
    objective: Objective,
    accepted: tuple[Accepted, ...],
    estimated: Estimated,
    log: DecisionLog,
) -> tuple[tuple[Accepted, ...], Estimated]:
    """The same with one effect at a place for those there and near it, if it says them all."""
    places = (at, *effect.near(objective.scene, at))
    said = [p for p in estimated.hypothesis if p.effect.id in effect.unites]
    parts = [p for p in said if p.at in places]
    rest = [p for p in estimated.hypothesis if p not in parts]
    union = _union(effect, at, parts, objective) if len(parts) > 1 else None
    if union is None or any(excluded(union, p) for p in rest):
        return accepted, estimated
    again = estimate(objective, (*rest, union), estimated.hypothesis)
    law = again.hypothesis[-1]
    lost = -worth(objective, again.assessed, estimated.assessed)
    one = lost < THRESHOLDS.min_nats and _shown(objective, again, estimated)
    reason = f"{law} says {'as much alone' if one else 'less, or nothing of its own'}"
    for part in parts:
        log.add(part, "simplified", not one, lost, THRESHOLDS.min_nats, reason)
    if not one:
        return accepted, estimated
    keys = {p.key for p in rest}
    kept = [a for a in accepted if a.planted.key in keys]
    return (*kept, _accepted(law, objective, tuple(parts))), again


def _shown(objective: Objective, union: Estimated, parts: Estimated) -> bool:
    """Tell whether what the last law says of its own shows, and is not one of its parts alone."""
    law, estimates = union.hypothesis[-1], union.estimates[-1]
    intervals = {name: e.ci95 for name, e in estimates.items()}
    if law.simpler(objective.motion, intervals) is None:
        return True
    return union.assessed.loglik - parts.assessed.loglik > THRESHOLDS.evident_nats


def _union(
    effect: Uniting, at: Location, parts: Sequence[Planted], objective: Objective
) -> Planted | None:
    """The one effect that says at a place what several there and near it do; None if it cannot."""
    theta = effect.union(objective.motion, at, {(p.effect.id, p.at): p.theta for p in parts})
    return None if theta is None else Planted(effect, at, theta)


def _said(law: Planted, others: Sequence[Planted]) -> bool:
    """Tell whether another effect has a law in it already."""
    return any(excluded(law, other) for other in others)


def _note(
    log: DecisionLog, larger: Planted, law: Planted, said: bool, kept: bool, why: str
) -> None:
    """Log whether a larger law stays beside its simpler one, by their numbers of parameters."""
    sizes = float(larger.effect.n_free), 0.0 if said else float(law.effect.n_free)
    reason = "needed" if kept else f"{why} {law}" + said * ", as another has it"
    log.add(larger, "simplified", kept, *sizes, reason)


def _accepted(law: Planted, objective: Objective, rivals: tuple[Planted, ...] = ()) -> Accepted:
    """A law that takes the place of others, by the first of its shapes."""
    shape = next(iter(law.effect.shapes(objective.motion, law.at)), None)
    return Accepted(law, shape, rivals)
