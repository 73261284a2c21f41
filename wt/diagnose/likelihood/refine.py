"""Gauss-Newton on replays, many hypotheses side by side.

All hypotheses and their finite-difference neighbours are replayed in one batch; each then takes a
damped step, bounded, with the tolerances adapting along (the bounded linear problem is scipy's).

A parameter that data hardly tell, such as where along its only axis a load sits, would drift from
step to step to its bound: a proximal term of its ``prior_std`` keeps it where it was. It is on the
step and not on the parameter, so that what data do tell is found without bias (Rockafellar, 1976).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.replays import DEVIATION
from wt.diagnose.likelihood.shown import shown, without_hidden
from wt.diagnose.stop import StoppedError
from wt.physics.limbs import limbs
from wt.physics.planted import Hypothesis, Key, Planted
from wt.physics.scales import step_sizes

Slopes = Mapping[Key, Float[np.ndarray, "sample dof _"]]
"""Derivatives of projected errors in the parameters of effects."""
NO_SLOPES: Slopes = MappingProxyType({})

_RELATIVE_STEP = 0.01
_SEEN, _LONGEST = 0.1, 20.0
"""Differences are taken so far apart that errors change by this share of themselves, but over no
more than so many of the smallest steps: what a shorter one changes is lost in the replays' own
roughness, where friction catches a step earlier or later."""
_DAMPING = 0.03  # to begin with
_TRIALS = (1e-6, 1.0)  # factors on it, tried side by side: a valley needs hardly any
_SAME = 0.05  # share of a step that makes no other one
_CONVERGED = 0.05  # nats gained in a step


@dataclass(frozen=True, eq=False)
class _Climb:
    """One hypothesis on its way up.

    Attributes:
        free: which of its parts move.
        now: where it is.
        slope: derivatives where it was, None to begin with.
        damping: Levenberg-Marquardt's.
        done: whether another step would not help.
    """

    free: tuple[int, ...]
    now: Assessed
    slope: Float[np.ndarray, "sample dof parameter"] | None = None
    damping: float = _DAMPING
    done: bool = False


def refine(
    objective: Objective,
    starts: Sequence[Hypothesis],
    free: Sequence[Sequence[int]],
    iterations: int = 3,
    centres: Sequence[Float[np.ndarray, " tolerance"]] | None = None,
    known: Slopes = NO_SLOPES,
) -> list[Assessed]:
    """Improve hypotheses.

    Args:
        objective: what they are judged by; its reference should be close to them.
        starts: where they start.
        free: for each, which of its parts may change.
        iterations: most steps that are taken.
        centres: tolerances of each start [deviations]; those of the reference if left out.
        known: slopes in some parts, for all starts: as good as their own where these differ in
            other parts, since only replays say whether a step is one.

    Returns:
        The improved hypotheses, in the order given.
    """
    evaluated = _settled(objective, objective.evaluate(starts, centres))
    climbs = [_Climb(tuple(f), a, done=not len(f)) for f, a in zip(free, evaluated, strict=True)]
    with suppress(StoppedError):
        for _ in range(iterations):
            active = [i for i, c in enumerate(climbs) if not c.done and np.isfinite(c.now.loglik)]
            if not active:
                break
            steps_taken = _step(objective, [climbs[i] for i in active], known)
            for i, climb in zip(active, steps_taken, strict=True):
                climbs[i] = climb
    return [c.now for c in climbs]


def together(objective: Objective, hypothesis: Hypothesis, some: Sequence[int]) -> list[int]:
    """Parts of a hypothesis that have to adapt to some of them: those that act on the same limbs.

    Args:
        objective: whose machine; its limbs may hang apart from each other.
        hypothesis: effects.
        some: indices of parts that are new, or changed.
    """
    motion = objective.stretches[0].motion
    apart = None if motion is None else limbs(objective.scene, motion)
    if apart is None:
        return list(range(len(hypothesis)))
    return apart.together(hypothesis, some)


def around_itself(
    objective: Objective, fit: Assessed, beside: Assessed, new: Sequence[int], known: Slopes
) -> Assessed:
    """A fit refined with tolerances that are linear around itself; as it is if that is no better.

    It becomes the reference of the replays. Tolerances that hardly differ from those of another fit
    are taken from there: limbs in which nothing is different are then replayed once for all. So is
    what tolerances change, where a replay says that it will do.

    Args:
        objective: the replays.
        fit: the fit.
        beside: what it is compared with.
        new: its parts that others have to adapt to.
        known: slopes in others, as near as where what is new was not there.
    """
    alike = np.abs(fit.tolerances - beside.tolerances) <= DEVIATION
    centre = np.where(alike, beside.tolerances, fit.tolerances)
    other = beside.hypothesis if len(beside.hypothesis) == len(fit.hypothesis) else None
    again = objective.reference(fit.hypothesis, centre, most=1, beside=other)
    parts = [together(objective, again.hypothesis, new)]
    (again,) = refine(objective, [again.hypothesis], parts, iterations=2, known=known)
    return max(fit, again, key=lambda a: a.loglik)


def jacobian(
    objective: Objective,
    at: Sequence[Assessed],
    free: Sequence[Sequence[int]],
    before: Sequence[Float[np.ndarray, "sample dof _"] | None] | None = None,
    known: Slopes = NO_SLOPES,
) -> list[Float[np.ndarray, "sample dof _"]]:
    """Derivatives of the projected errors in the free parameters of each.

    Args:
        objective: whose errors.
        at: where.
        free: for each, the parts that have these parameters.
        before: derivatives somewhere near, which say how far apart to take differences.
        known: derivatives in some parts, that are taken as they are.
    """
    neighbours: list[Hypothesis] = []
    centres: list[Float[np.ndarray, " tolerance"]] = []
    sizes: list[Float[np.ndarray, " parameter"]] = []
    for assessed, parts, near in zip(at, free, before or [None] * len(at), strict=True):
        theta = pack(assessed.hypothesis, parts)
        lower, upper = bounds(assessed.hypothesis, parts)
        least = steps(objective, assessed.hypothesis, parts)
        # what has no step is a choice or was read off, and stays
        step = np.where(least > 0.0, np.maximum(least, _RELATIVE_STEP * np.abs(theta)), 0.0)
        if near is not None:
            step = np.clip(_seen(objective, assessed, near), step, _LONGEST * step)
        step *= objective.nudge
        up, down = np.minimum(step, upper - theta), np.minimum(step, theta - lower)
        step = np.where((up == step) | (up >= down), up, -down)
        for i, rows in rows_of(assessed.hypothesis, parts):
            if assessed.hypothesis[i].key in known:
                step[rows] = 0.0
        for k in np.flatnonzero(step):
            moved = theta.copy()
            moved[k] += step[k]
            neighbours.append(unpack(assessed.hypothesis, parts, moved))
            centres.append(assessed.centre)
        sizes.append(step)
    moved_to = iter(objective.errors(neighbours, centres) if neighbours else ())
    result = []
    for assessed, parts, step in zip(at, free, sizes, strict=True):
        slope, asked = np.zeros((*assessed.error.shape, len(step))), np.flatnonzero(step)
        others = [next(moved_to) for _ in asked]
        if others:
            slope[:, :, asked] = objective.change(assessed, others) / step[asked]
        for i, rows in rows_of(assessed.hypothesis, parts):
            if assessed.hypothesis[i].key in known:
                slope[:, :, rows] = known[assessed.hypothesis[i].key]
        result.append(np.nan_to_num(slope))
    return result


def slopes_at(
    objective: Objective,
    now: Assessed,
    before: Float[np.ndarray, "sample dof parameter"] | None = None,
    known: Slopes = NO_SLOPES,
) -> Float[np.ndarray, "sample dof parameter"]:
    """Derivatives in all parameters of a hypothesis, by differences that replays tell from nothing.

    Args:
        objective: whose errors.
        now: where.
        before: derivatives somewhere near; taken here, by the smallest differences, if left out.
        known: derivatives in some parts, that are taken as they are.
    """
    if not now.hypothesis:
        return np.zeros((*now.error.shape, 0))
    parts = [range(len(now.hypothesis))]
    if before is None:
        (before,) = jacobian(objective, [now], parts, known=known)
    return jacobian(objective, [now], parts, [before], known)[0]


def slopes_of(
    hypothesis: Hypothesis, slope: Float[np.ndarray, "sample dof parameter"]
) -> dict[Key, Float[np.ndarray, "sample dof _"]]:
    """Derivatives in all parts of a hypothesis, part by part."""
    everywhere = rows_of(hypothesis, range(len(hypothesis)))
    return {hypothesis[i].key: slope[:, :, rows] for i, rows in everywhere}


def all_slopes(objective: Objective, now: Assessed, known: Slopes = NO_SLOPES) -> Slopes:
    """Derivatives in all parts of a hypothesis, by differences that replays tell from nothing.

    Those that are known of some parts are taken as they are.
    """
    return slopes_of(now.hypothesis, slopes_at(objective, now, known=known))


def rows_of(hypothesis: Hypothesis, parts: Sequence[int]) -> Iterator[tuple[int, slice]]:
    """Each of some parts, and where its parameters are among those of all."""
    start = 0
    for i in parts:
        rows = slice(start, start + hypothesis[i].effect.n_theta)
        start = rows.stop
        yield i, rows


def _seen(
    objective: Objective, at: Assessed, slope: Float[np.ndarray, "sample dof parameter"]
) -> Float[np.ndarray, " parameter"]:
    """Steps that change the errors by some share of themselves."""
    weights = objective.channels.precision(at.variance)
    error = float(np.sum(weights * at.error**2))
    change = np.einsum("ij,ijk->k", weights, slope**2)
    return np.asarray(_SEEN * np.sqrt(error) / np.sqrt(np.maximum(change, 1e-300)))


def _settled(objective: Objective, assessed: Sequence[Assessed]) -> list[Assessed]:
    """Assess once more where the base floats, with the tolerances that each hypothesis then has.

    There are many links there and they move far from the reference's: what is linear around it
    falls so short that a step away from it seems to lose what it gains.
    """
    if not objective.scene.free:
        return list(assessed)
    again = objective.evaluate([a.hypothesis for a in assessed], [a.tolerances for a in assessed])
    return [max(pair, key=lambda a: a.loglik) for pair in zip(assessed, again, strict=True)]


def _step(objective: Objective, climbs: Sequence[_Climb], known: Slopes) -> list[_Climb]:
    at, free = [c.now for c in climbs], [c.free for c in climbs]
    jacobians = jacobian(objective, at, free, [c.slope for c in climbs], known)
    pairs = zip(climbs, jacobians, strict=True)
    ways = [_ways(objective, climb, slope) for climb, slope in pairs]
    flat = [way for each in ways for way in each]
    assessed = iter(objective.evaluate([h for h, _ in flat], [centre for _, centre in flat]))
    tried = [[next(assessed) for _ in each] for each in ways]
    likeliest = [max(range(len(each)), key=lambda k: each[k].loglik) for each in tried]
    settled = _settled(objective, [each[k] for each, k in zip(tried, likeliest, strict=True)])
    result = []
    climbs = [replace(c, slope=slope) for c, slope in zip(climbs, jacobians, strict=True)]
    for climb, k, best in zip(climbs, likeliest, settled, strict=True):
        gained = best.loglik - climb.now.loglik
        if gained <= 0.0:
            # even the damped step failed: damp more, give up once that is hopeless
            damping = climb.damping * 1e3
            result.append(replace(climb, damping=damping, done=damping > 1e4))
        else:
            damping = climb.damping * (10.0 if k else 0.1)
            result.append(replace(climb, now=best, damping=damping, done=gained < _CONVERGED))
    return result


def _ways(
    objective: Objective, climb: _Climb, slope: Float[np.ndarray, "sample dof parameter"]
) -> list[tuple[Hypothesis, Float[np.ndarray, " tolerance"]]]:
    """Where steps of each damping lead: the hypothesis, and the tolerances beside it.

    One, where damping hardly changes it: that of a single parameter, as a rule.
    """
    free = [climb.now.hypothesis[i] for i in climb.free]
    visible = shown(free, slope, objective.channels.precision(climb.now.variance))
    reach = [p.reach() for p in free]
    lower, upper = (np.concatenate(ends) for ends in zip(*reach, strict=True))
    prior_std = np.array(
        [q.prior_std for p in free for q in p.effect.parameters for _ in range(q.size)]
    )
    ends = np.cumsum([p.effect.n_theta for p in free])[:-1]
    here, ways = pack(climb.now.hypothesis, climb.free), []
    places: list[Float[np.ndarray, " parameter"]] = []
    for factor in _TRIALS:
        damping = climb.damping * factor
        centre, step = objective.solve(climb.now, slope @ visible, lower, upper, damping, prior_std)
        own = np.split(visible @ step, ends)
        moved = np.concatenate([p.moved(x) for p, x in zip(free, own, strict=True)])
        moved = without_hidden(free, moved, visible)
        if places and (np.abs(moved - places[0]) <= _SAME * np.abs(places[0] - here)).all():
            break
        places.append(moved)
        ways.append((unpack(climb.now.hypothesis, climb.free, moved), centre))
    return ways


def pack(hypothesis: Hypothesis, parts: Sequence[int]) -> Float[np.ndarray, " parameter"]:
    """Parameters of some parts of a hypothesis, one after another."""
    return np.concatenate([hypothesis[i].theta for i in parts])


def unpack(
    hypothesis: Hypothesis, parts: Sequence[int], theta: Float[np.ndarray, " parameter"]
) -> Hypothesis:
    """The hypothesis with other parameters of some parts."""
    changed = list(hypothesis)
    for i, rows in rows_of(hypothesis, parts):
        changed[i] = Planted(hypothesis[i].effect, hypothesis[i].at, theta[rows])
    return tuple(changed)


def bounds(
    hypothesis: Hypothesis, parts: Sequence[int]
) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
    """Smallest and largest admissible parameters of some parts."""
    pairs = [hypothesis[i].effect.bounds() for i in parts]
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


def steps(
    objective: Objective, hypothesis: Hypothesis, parts: Sequence[int]
) -> Float[np.ndarray, " parameter"]:
    """Smallest changes that matter of the parameters of some parts, on this machine."""
    return np.concatenate([step_sizes(hypothesis[i], objective.motion) for i in parts])
