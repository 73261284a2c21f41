"""Parameters with honest intervals: all fitted data, all effects together, beside the tolerances.

The covariance is a sandwich over blocks longer than the errors' memory (H. White, 1982; D. W. K.
Andrews, 1991): it holds although neighbouring errors resemble each other and the model is not
exact. The tolerances enter with their prior spread, so that what they could explain widens the
intervals of what they are confused with. What no data of one kind of motion can show is that a
machine follows a law of a library only roughly: ``thresholds.law_strength`` is added for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import chi2
from scipy.stats import t as student

from wt.diagnose.likelihood.named import named
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import (
    bounds,
    jacobian,
    pack,
    refine,
    rows_of,
    slopes_at,
    slopes_of,
    steps,
    unpack,
)
from wt.diagnose.likelihood.shown import shown
from wt.diagnose.likelihood.tolerances import absorbed, alike, boxes
from wt.diagnose.result import Estimate
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Parameter
from wt.physics.planted import Hypothesis
from wt.physics.units import units_at

BLOCK_S = 2.0
"""Length of a block [s]: longer than a servo's or a gravity-loaded joint's memory."""
_SETTLED, _NEAR = 3, 0.02
"""Most fits, each with tolerances linear around the last: none where the parameters moved by less
than this share."""

_NO_LOSS = 0.5 * float(chi2.ppf(0.95, 1))
"""Loss of log-likelihood inside a 95 % interval of one parameter [nats] (S. S. Wilks, 1938)."""
_FACTORS, _TIMES, _NO_ENDS = np.array([[0.5], [2.0]]), 3, np.array([[0.0], [np.inf]])
"""What is as good so often halved, or doubled, has no end that these recordings show."""
_FLAT, _HALVED = 30.0, 3
"""A parameter of which half, or twice, loses less [nats] may be flat in between: curvature where it
is tells nothing of its end, which is looked for by halving the way so often."""
_DAMPED, _FITTED = 1e-6, 3
"""Damping and number of the steps in which others are fitted beside one that is held."""
_UNSEEN, _MEMBER = 1e-8, 1e-3
"""Curvature that differences of replays cannot tell from none, as a share of the largest; least
component of what belongs to such a direction."""


@dataclass(frozen=True, eq=False)
class Estimated:
    """Effects with their final parameters.

    Attributes:
        assessed: the hypothesis on all fitted data.
        estimates: for each part, its parameters by name.
        combined: parts of whose parameters recordings show a combination only.
    """

    assessed: Assessed
    estimates: tuple[dict[str, Estimate], ...]
    combined: frozenset[int] = frozenset()

    @property
    def hypothesis(self) -> Hypothesis:
        """The effects with their final parameters."""
        return self.assessed.hypothesis


def estimate(
    objective: Objective, start: Hypothesis, beside: Hypothesis | None = None
) -> Estimated:
    """Fit all effects together, down to noise, and estimate how well they are known.

    Args:
        objective: the replays.
        start: the effects, with the parameters that they start from.
        beside: effects with much the same tolerances, as before some have left.
    """
    now = objective.reference(start, beside=beside)
    if not start:
        return Estimated(now, ())
    parts, sharp = range(len(start)), objective.sharper()
    smallest = steps(objective, start, parts)
    now, slope = _refined(objective, now, smallest)
    best = now
    if sharp is not objective:
        begun = sharp.reference(now.hypothesis, now.tolerances)
        best, slope = _refined(sharp, begun, smallest, slope)
        now = objective.reference(best.hypothesis, best.tolerances)
    theta, slope = pack(best.hypothesis, parts), slopes_at(sharp, best, slope)
    precision = sharp.channels.precision(best.variance)
    visible = shown(best.hypothesis, slope, precision)
    spread = _spread(sharp, best, slope @ visible)
    spread = np.hypot(spread, least_spread(best.hypothesis, smallest))
    unseen = _unseen(slope, precision, visible)
    spread[unseen] = np.inf
    lower, upper = bounds(now.hypothesis, parts)
    small, large = _as_good(objective, now, theta, unseen)
    low = np.maximum(np.minimum(theta - spread, small), lower)
    high = np.minimum(np.maximum(theta + spread, large), upper)
    combined = frozenset(
        i
        for i, rows in rows_of(now.hypothesis, parts)
        if _unseen(slope[:, :, rows], precision, visible[rows, rows]).any()
    )
    estimates = []
    for i, rows in rows_of(now.hypothesis, parts):
        planted = now.hypothesis[i]
        units = units_at(objective.scene, planted.at)
        estimates.append(
            named(planted, units, low[rows], high[rows], smallest[rows], visible[rows, rows])
        )
    return Estimated(now, tuple(estimates), combined)


def fitted(objective: Objective, start: Hypothesis, beside: Hypothesis | None = None) -> Assessed:
    """All effects fitted together, without a word of how well they are known."""
    now = objective.reference(start, beside=beside)
    return _refined(objective, now, steps(objective, start, range(len(start))))[0] if start else now


def _refined(
    objective: Objective,
    now: Assessed,
    smallest: Float[np.ndarray, " parameter"],
    slope: Float[np.ndarray, "sample dof parameter"] | None = None,
) -> tuple[Assessed, Float[np.ndarray, "sample dof parameter"]]:
    """All effects refined, each with what its own tolerance took of it, linear around the last.

    Where the last is far worse than another that was linearised around, that one comes back. The
    steps of a fit share the slopes where it began: those of the last are where it ends.

    Args:
        objective: what they are judged by.
        now: where to begin, its reference.
        smallest: changes of the parameters that matter.
        slope: derivatives somewhere near.

    Returns:
        (the fit; derivatives where the last one began).
    """
    parts, best = range(len(now.hypothesis)), now
    for _ in range(_SETTLED):
        before, slope = now.hypothesis, slopes_at(objective, now, slope)
        known = slopes_of(before, slope)
        (now,) = refine(objective, [before], [parts], iterations=3, known=known)
        own = alike(objective.tolerances, now.hypothesis)
        whole = absorbed(objective.tolerances, now.tolerances, now.hypothesis)
        theta = pack(whole, parts)
        moved = (np.abs(theta - pack(before, parts)) > _NEAR * np.abs(theta) + smallest).any()
        if moved or own.any():
            now = objective.reference(whole, np.where(own, 0.0, now.tolerances))
            best = max(best, now, key=lambda fit: fit.loglik)
        if not moved:
            break
    assert slope is not None
    if now.loglik < best.loglik - THRESHOLDS.min_nats:  # what was linear promised far too much
        now = objective.reference(best.hypothesis, best.centre)
    return now, slope


def distances_from_nothing(estimated: Estimated) -> dict[int, float]:
    """Effects that may as well be nothing, by index: their distance from it [interval widths].

    Those are the effects whose intervals hold all of their neutral values (A. Wald, 1943). Where
    only a product shows, each factor may be as good as nothing, and the effect is none of these.
    """
    distances: dict[int, float] = {}
    for i, planted in enumerate(estimated.hypothesis):
        if i in estimated.combined:
            continue
        known = [p for p in planted.effect.parameters if p.neutral is not None]
        widths = [_from_neutral(p, estimated.estimates[i][p.name]) for p in known]
        if widths and np.isfinite(widths).all():
            distances[i] = max(widths)
    return distances


def _from_neutral(parameter: Parameter, estimate: Estimate) -> float:
    """Distance from its neutral value in widths of the interval; infinite if that is outside."""
    assert parameter.neutral is not None
    neutral = max(parameter.neutral, parameter.lower)
    low, high = (np.atleast_1d(end) for end in estimate.ci95)
    if ((neutral < low) | (neutral > high)).any():
        return np.inf
    return float((np.abs(np.atleast_1d(estimate.value) - neutral) / (high - low)).max())


def _spread(
    objective: Objective, now: Assessed, slope: Float[np.ndarray, "sample dof parameter"]
) -> Float[np.ndarray, " parameter"]:
    """Half width of the 95 % intervals of the parameters."""
    hessian, scores, blocks = _curvature(objective, now, slope)
    p, n = slope.shape[2], len(hessian)
    settled = np.concatenate(
        [np.zeros(p, bool), boxes(objective.tolerances, now.hypothesis) == 0.0]
    )
    if objective.scene.free:  # rough derivatives tell them from an effect, and nothing else can
        settled[p:] |= alike(objective.tolerances, now.hypothesis)
        # soft drives hold all bodies: what pulls at one may be the weight of another
        if any(q.at.kind == "body" for q in now.hypothesis):
            settled[p:] |= [n.effect.at_rest for n in objective.tolerances]
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled, free = hessian / scale / scale[:, None], np.flatnonzero(~settled)
    inverse = np.zeros((n, n))
    inverse[np.ix_(free, free)] = np.linalg.pinv(scaled[np.ix_(free, free)], rcond=1e-10)
    meat = scores.T @ scores / scale / scale[:, None]
    # the tolerances' true values scatter around zero by one standard deviation each
    meat[range(p, n), range(p, n)] += 1.0 / scale[p:] ** 2
    covariance = (inverse @ meat @ inverse) / scale / scale[:, None]
    freedom = max(blocks - p, 2)
    # those that were taken to be nothing do so too, and go into the parameters as they are
    blamed = inverse @ (scaled[:, settled] * scale[settled]) / scale[:, None]
    # of what hardly shows, scores are as good as none, and their scatter says nothing of it
    likely = np.maximum(np.diag(covariance), np.diag(inverse) / scale**2)
    variance = likely + (blamed**2).sum(axis=1)
    deviation = np.sqrt(np.maximum(variance[:p], 0.0))
    # what the replays' steps may still be wrong by, seen through the same estimator
    numerical = inverse @ (_numerical_score(objective, now, slope) / scale) / scale
    return np.asarray(np.hypot(student.ppf(0.975, freedom) * deviation, 2.0 * numerical[:p]))


def _unseen(
    slope: Float[np.ndarray, "sample dof parameter"],
    precision: Float[np.ndarray, "sample dof"],
    visible: Float[np.ndarray, "parameter parameter"],
) -> Bool[np.ndarray, " parameter"]:
    """Parameters of which recordings show a combination only.

    One of which they show nothing by itself is another matter: a law may hold whatever it is. So
    are directions of one vector, see :func:`shown`.
    """
    flat = ((slope @ visible) * np.sqrt(precision)[:, :, None]).reshape(-1, slope.shape[2])
    sizes = np.linalg.norm(flat, axis=0)
    seen = sizes > 0.0
    scaled = flat[:, seen] / sizes[seen]
    hidden = (np.eye(len(visible)) - visible)[np.ix_(seen, seen)]
    squares, directions = np.linalg.eigh(scaled.T @ scaled + hidden)
    combinations = directions[:, squares < _UNSEEN * squares.max(initial=0.0)]
    unseen = np.zeros(len(seen), bool)
    unseen[seen] = (np.abs(combinations) > _MEMBER).any(axis=1)
    return unseen


def _as_good(
    objective: Objective,
    now: Assessed,
    theta: Float[np.ndarray, " parameter"],
    unseen: Bool[np.ndarray, " parameter"],
) -> Float[np.ndarray, "end parameter"]:
    """How small, and how large, each size may be without any loss: curvature where it is says not.

    Friction in which nothing slipped, a limit that nothing reached: beyond some size such a law
    does what it does anyway. And what only combinations show, as of a spring that is half as stiff
    and tied twice as far away, changes beside the others (D. J. Venzon, S. H. Moolgavkar, 1988).

    Args:
        objective: the replays.
        now: the fitted hypothesis.
        theta: its parameters.
        unseen: those of which only combinations show.

    Returns:
        Parameters; zero or infinite where no multiple that is tried makes a difference.
    """
    parts, count = range(len(now.hypothesis)), np.arange(len(theta))
    each = [p for q in now.hypothesis for p in q.effect.parameters for _ in range(p.size)]
    sizes = np.array([p.size == 1 and p.lower >= 0.0 and p.public for p in each])
    going = np.stack([sizes & (theta > 0.0)] * 2)
    tried = {(end, k): theta for end, k in np.argwhere(going).tolist()}
    multiple = np.ones((2, len(theta)))
    for _ in range(_TIMES):
        ways = np.argwhere(going).tolist()
        if not ways:
            break
        for end, k in ways:
            tried[end, k] = np.where(count == k, _FACTORS[end] * tried[end, k], tried[end, k])
            if unseen[k]:
                tried[end, k] = _others_fitted(objective, now, tried[end, k], k)
        fits = objective.evaluate([unpack(now.hypothesis, parts, tried[e, k]) for e, k in ways])
        losses = np.array([now.loglik - f.loglik for f in fits])
        going[going] = losses < _NO_LOSS
        multiple = np.where(going, multiple * _FACTORS, multiple)
        flat = [
            (end, k)
            for (end, k), loss in zip(ways, losses, strict=True)
            if _NO_LOSS <= loss < _FLAT and multiple[end, k] == 1.0 and not unseen[k]
        ]
        if flat:
            ends, of = np.array(flat).T
            multiple[ends, of] = _between(objective, now, theta, of, _FACTORS[ends, 0])
    return np.where(going, _NO_ENDS, multiple * theta)


def _between(
    objective: Objective,
    now: Assessed,
    theta: Float[np.ndarray, " parameter"],
    of: Int[np.ndarray, " end"],
    lost: Float[np.ndarray, " end"],
) -> Float[np.ndarray, " end"]:
    """Multiples of parameters up to which nothing is lost, between one and those at which it is.

    What a law does without slipping, or without reaching its limit, has no curvature there.
    """
    parts, low, high = range(len(now.hypothesis)), np.zeros(len(of)), np.ones(len(of))
    for _ in range(_HALVED):
        share = 0.5 * (low + high)
        there = np.tile(theta, (len(of), 1))
        there[np.arange(len(of)), of] *= lost**share
        fits = objective.evaluate([unpack(now.hypothesis, parts, x) for x in there])
        as_good = np.array([fit.loglik > now.loglik - _NO_LOSS for fit in fits])
        low, high = np.where(as_good, share, low), np.where(as_good, high, share)
    return np.asarray(lost**low)


def _others_fitted(
    objective: Objective, now: Assessed, theta: Float[np.ndarray, " parameter"], held: int
) -> Float[np.ndarray, " parameter"]:
    """Parameters of which all but one are fitted, inside their bounds, until nothing is lost."""
    parts = range(len(now.hypothesis))
    lower, upper = bounds(now.hypothesis, parts)
    for _ in range(_FITTED):
        (there,) = objective.evaluate([unpack(now.hypothesis, parts, theta)], [now.tolerances])
        if there.loglik > now.loglik - _NO_LOSS or not np.isfinite(there.loglik):
            break
        (slope,) = jacobian(objective, [there], [parts])
        slope[:, :, held] = 0.0
        _, step = objective.solve(there, slope, lower - theta, upper - theta, _DAMPED)
        theta = np.clip(theta + step, lower, upper)
    return theta


def least_spread(
    hypothesis: Hypothesis, smallest: Float[np.ndarray, " parameter"]
) -> Float[np.ndarray, " parameter"]:
    """Half width below which no interval makes sense, however much data there is.

    The smallest change that matters; and for what is measured from nothing, a share of it.
    """
    widths: list[float] = []
    for planted in hypothesis:
        for p, rows in planted.effect.rows():
            size = float(np.linalg.norm(planted.theta[rows]))
            usual = THRESHOLDS.law_strength if p.lower >= 0.0 and p.unit != "-" else 0.0
            widths += [(p.inexact or usual) * size] * p.size
    return np.asarray(np.hypot(smallest, widths))


def _curvature(
    objective: Objective, now: Assessed, slope: Float[np.ndarray, "sample dof parameter"]
) -> tuple[Float[np.ndarray, "adapting adapting"], Float[np.ndarray, "block adapting"], int]:
    """Curvature and scores, of which intervals are made.

    Args:
        objective: the replays.
        now: the fitted hypothesis.
        slope: Jacobian of its error in the parameters.

    Returns:
        (Hessian of parameters and tolerances, the tolerances' prior included; score of each
        block; number of blocks).
    """
    both = np.concatenate([slope, objective.columns], axis=2)
    p, n = slope.shape[2], both.shape[2]
    weighted = both * objective.channels.precision(now.variance)[:, :, None]
    hessian = weighted.reshape(-1, n).T @ both.reshape(-1, n)
    hessian[range(p, n), range(p, n)] += 1.0
    left = objective.left(now)
    labels = np.stack([objective.recording, (objective.t / BLOCK_S).astype(int)], axis=1)
    _, block = np.unique(labels, axis=0, return_inverse=True)
    count = int(block.max()) + 1
    scores = np.zeros((count, n))
    np.add.at(scores, block.ravel(), np.einsum("ijk,ij->ik", weighted, left))
    return hessian, scores, count


def _numerical_score(
    objective: Objective, now: Assessed, slope: Float[np.ndarray, "sample dof parameter"]
) -> Float[np.ndarray, " adapting"]:
    """Score of what the steps' length may still do, of parameters and tolerances."""
    both = np.concatenate([slope, objective.columns], axis=2)
    error = objective.channels.precision(now.variance) * objective.numerical_error(now)
    return np.asarray(np.einsum("ijk,ij->k", both, error))
