"""Several laws of one joint at once: all smooth ones are fitted together, then the needless leave.

A servo's gain, its damping, and its joint's friction and rotor may all be off. One at a time, the
search takes what stands in for two of them, such as gear play, and nothing that joins later shows
what the first should have been. The other way round none stands in for others: all laws that a
force is linear in are fitted together, and of these leave, one by one, what says least beside the
rest (general to specific: D. F. Hendry, Dynamic Econometrics, 1995). Which leave is decided on the
replays' slopes, and costs no replay.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import get_args

import numpy as np

from wt.diagnose.likelihood.bic import merit
from wt.diagnose.likelihood.bounded import NormalEquations
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.selection.in_turn import parts_of
from wt.diagnose.selection.smooth_laws import (
    DAMPINGS,
    Laws,
    LawSlopes,
    Theta,
    alone,
    laws_of,
    solved,
    together,
)
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Common, Shape
from wt.physics.planted import Key, Planted

_RIDGE = 1e-9  # of the squares


def several(
    objective: Objective, now: Assessed, dof: int, banned: Container[Key] = frozenset()
) -> list[tuple[Planted, Shape]]:
    """Smooth laws of a joint that may say together what is found there, and more.

    Args:
        objective: the replays, linearised around the present hypothesis.
        now: the present hypothesis.
        dof: degree of freedom of the joint.
        banned: what must not join.

    Returns:
        Laws, with the shapes of their signatures, to take the place of all that is found at this
        joint alone; none where that is as good.
    """
    laws = laws_of(objective, now, [dof], banned)
    theta = np.array([law.start for law in laws.each])
    (there,) = objective.evaluate([laws.hypothesis(theta, range(len(laws.each)))])
    if not laws.each or not np.isfinite(there.loglik):
        return []
    there, slope, theta = together(laws, there, theta)
    if not there.loglik > now.loglik + THRESHOLDS.min_nats:
        return []
    left, kept = _needed(laws, there, slope, theta)
    if not left > merit(objective, now):
        return []
    _, said = solved(laws, there, slope, theta, kept)
    return [laws.each[i].planted(float(said[i])) for i in kept]


def _foretold(
    laws: Laws,
    there: Assessed,
    slope: LawSlopes,
    theta: Theta,
    kept: list[int],
) -> float:
    """Log-likelihood of each recording by what the others say of some of the laws, by the slopes.

    Many laws fit whatever a machine does in one motion; what is its own, another motion has too.
    Parts of the only recording stand in for recordings. Of a law that the others hardly excite
    they say nothing: there it is as all of them have it.
    """
    channels, fit = laws.objective.channels, alone(laws, there, slope, theta, kept, DAMPINGS[0])
    own, left = slope[:, :, kept], np.zeros_like(fit.left)
    weights = np.where(channels.valid, channels.precision(there.variance), 0.0)
    whole = np.einsum("nd,ndi->i", weights, own**2)
    for part in parts_of(laws.objective):
        rest = weights * ~part[:, None]
        gram = np.einsum("nd,ndi,ndj->ij", rest, own, own)
        right = -np.einsum("nd,nd,ndi->i", rest, fit.left, own)
        told = np.diag(gram) > THRESHOLDS.seldom_excited * whole
        step = fit.step.copy()
        if told.any():
            known = right[told] - gram[np.ix_(told, ~told)] @ step[~told]
            normal = NormalEquations(gram[np.ix_(told, told)], known, _RIDGE)
            step[told] = normal.active_set(fit.low[told], fit.high[told])
        left[part] = (fit.left + own @ step)[part]
    return channels.nats(channels.variance(channels.sums(left**2)))


def _needed(laws: Laws, there: Assessed, slope: LawSlopes, theta: Theta) -> tuple[float, list[int]]:
    """Laws that are left once what says least beside the others has gone, one by one.

    Of those that say the same the least usual goes first. So many go as leave the rest at their
    best in recordings that say nothing of their parameters; all, if nothing is better there.

    Returns:
        (merit by the slopes; the laws).
    """

    def usual(i: int) -> int:
        return get_args(Common).index(laws.each[i].forms[0][0].common)

    def merit_of(kept: Sequence[int]) -> float:
        return laws.merit_of(there, kept, *solved(laws, there, slope, theta, kept))

    def foretold(kept: list[int]) -> float:
        _, said = solved(laws, there, slope, theta, kept)
        return laws.merit_of(there, kept, _foretold(laws, there, slope, theta, kept), said)

    kept = [i for i, law in enumerate(laws.each) if not law.of_sensor]
    ways = [(merit_of(kept), kept)]
    while kept:
        less = {i: merit_of([k for k in kept if k != i]) for i in kept}
        best = max(less.values())
        close = [i for i in kept if less[i] > best - THRESHOLDS.evident_nats]
        leaves = min(close, key=lambda i: (usual(i), -less[i]))
        kept = [k for k in kept if k != leaves]
        ways.append((less[leaves], kept))
    return max(ways, key=lambda way: foretold(way[1]))
