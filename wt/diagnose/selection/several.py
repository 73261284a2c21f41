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
from dataclasses import replace
from typing import NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.bic import merit
from wt.diagnose.likelihood.bounded import NormalEquations
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import jacobian
from wt.diagnose.selection.candidates import excluded
from wt.diagnose.selection.in_turn import parts_of
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Common, Effect, Shape, effects
from wt.physics.hooks import OnOutputs, Remembering, shaped
from wt.physics.planted import Hypothesis, Key, Planted
from wt.types import Location

Theta = Float[np.ndarray, " law"]

_ROUNDS = 4
"""So often all laws are fitted together, each time linear around what the last one said."""
_DAMPINGS = (1e-6, 1e-2, 1.0)
"""Of steps that are tried side by side (Levenberg and Marquardt)."""
_RIDGE = 1e-9  # of the squares
_CONVERGED = 2.0  # nats that a step gains: replays refine what is left


class Law(NamedTuple):
    """A law of one parameter, in which its force is linear.

    Attributes:
        at: where.
        forms: it with the shape of its signature: more of it, and less where a model has any.
        start: its parameter where nothing is known of it.
    """

    at: Location
    forms: tuple[tuple[Effect, Shape], ...]
    start: float

    @property
    def nothing(self) -> float:
        """Its parameter where it is nothing."""
        neutral = self.forms[0][0].parameters[0].neutral
        assert neutral is not None
        return neutral

    def ends(self) -> tuple[float, float]:
        """Smallest and largest parameter."""
        parameters = [effect.parameters[0] for effect, _ in self.forms]
        return min(p.lower for p in parameters), max(p.upper for p in parameters)

    def planted(self, theta: float) -> tuple[Planted, Shape]:
        """It with such a parameter, in the form that has it."""
        effect, shape = next(
            (e, s) for e, s in self.forms if e.parameters[0].lower <= theta <= e.parameters[0].upper
        )
        return Planted(effect, self.at, np.array([theta])), shape


class _Joint(NamedTuple):
    """Laws of a joint beside what is found elsewhere.

    Attributes:
        objective: the replays.
        others: what is found elsewhere.
        laws: of the joint.
    """

    objective: Objective
    others: Hypothesis
    laws: tuple[Law, ...]

    def hypothesis(self, theta: Theta, kept: Sequence[int]) -> Hypothesis:
        """What is found elsewhere, and some of the laws."""
        return (*self.others, *(self.laws[i].planted(float(theta[i]))[0] for i in kept))


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
    others = tuple(p for p in now.hypothesis if objective.scene.dof_at(p.at) != dof)
    laws = tuple(
        law
        for law in _laws(objective, now, dof)
        if (law.forms[0][0].id, law.at.kind, law.at.name) not in banned
        and not any(excluded(law.planted(law.start)[0], p) for p in others)
    )
    joint = _Joint(objective, others, laws)
    theta = np.array([law.start for law in laws])
    (there,) = objective.evaluate([joint.hypothesis(theta, range(len(laws)))])
    if not laws or not np.isfinite(there.loglik):
        return []
    there, slope, theta = _together(joint, there, theta)
    if not there.loglik > now.loglik + THRESHOLDS.min_nats:
        return []
    left, kept = _needed(joint, there, slope, theta)
    if not left > merit(objective, now):
        return []
    solved = _solved(joint, there, slope, theta, kept)[1]
    return [joint.laws[i].planted(float(solved[i])) for i in kept]


def _laws(objective: Objective, now: Assessed, dof: int) -> list[Law]:
    """Laws of one joint or its drives, each from where it was found."""
    motion, scene, laws = objective.motion, objective.scene, []
    found = {p.key: p for p in now.hypothesis}
    for effect in effects().values():
        if effect.kind not in ("joint", "actuator") or effect.n_theta != 1:
            continue
        if isinstance(effect, Remembering):  # what it begins with is not linear in its parameter
            continue
        nothing = effect.parameters[0].neutral
        for at in (at for at in effect.places(scene) if scene.dof_at(at) == dof):
            shapes = effect.shapes(motion, at)
            if nothing is None or () not in shapes:
                continue
            present = found.get((effect.id, at.kind, at.name))
            start = nothing if present is None else float(present.theta[0])
            laws.append(Law(at, tuple((shaped(effect, s), s) for s in shapes), start))
    return laws


def _together(
    joint: _Joint, there: Assessed, theta: Theta
) -> tuple[Assessed, Float[np.ndarray, "sample dof law"], Theta]:
    """All laws fitted together: the fit, the replays' slopes there, and the parameters.

    Args:
        joint: the laws.
        there: where they begin.
        theta: their parameters there.
    """
    objective, every = joint.objective, range(len(joint.laws))
    parts = range(len(joint.others), len(joint.others) + len(joint.laws))
    (slope,) = jacobian(objective, [there], [parts])
    for _ in range(_ROUNDS):
        ways = [_solved(joint, there, slope, theta, every, d)[1] for d in _DAMPINGS]
        fits = objective.evaluate([joint.hypothesis(way, every) for way in ways])
        best = max(range(len(ways)), key=lambda k: fits[k].loglik)
        gained = fits[best].loglik - there.loglik
        if not gained > 0.0:
            break
        there, theta = fits[best], ways[best]
        (slope,) = jacobian(objective, [there], [parts], [slope])
        if gained < _CONVERGED:
            break
    return there, slope, theta


def _solved(
    joint: _Joint,
    there: Assessed,
    slope: Float[np.ndarray, "sample dof law"],
    theta: Theta,
    kept: Sequence[int],
    damping: float = _DAMPINGS[0],
) -> tuple[float, Theta]:
    """Log-likelihood and parameters of some of the laws alone, by the slopes."""
    objective, kept = joint.objective, list(kept)
    fit = _alone(joint, there, slope, theta, kept, damping)
    left = fit.left + slope[:, :, kept] @ fit.step
    variance = objective.channels.variance(objective.channels.sums(left**2))
    solved = np.array([law.nothing for law in joint.laws])
    solved[kept] = fit.theta
    return objective.channels.nats(variance) - 0.5 * float(fit.sizes @ fit.sizes), solved


class _Alone(NamedTuple):
    """Some of the laws alone, by the slopes.

    Attributes:
        left: error before the step, with tolerances adapted.
        step: of the parameters.
        low, high: shortest and longest.
        theta: where it leads.
        sizes: of the tolerances [deviations].
    """

    left: Float[np.ndarray, "sample dof"]
    step: Theta
    low: Theta
    high: Theta
    theta: Theta
    sizes: Float[np.ndarray, " tolerance"]


def _alone(
    joint: _Joint,
    there: Assessed,
    slope: Float[np.ndarray, "sample dof law"],
    theta: Theta,
    kept: list[int],
    damping: float,
) -> _Alone:
    """The step of some of the laws, the others being nothing."""
    objective = joint.objective
    nothing = np.array([law.nothing for law in joint.laws])
    gone = np.setdiff1d(np.arange(len(theta)), kept)
    error = there.error + slope[:, :, gone] @ (nothing - theta)[gone]
    ends = np.array([law.ends() for law in joint.laws])[kept].reshape(-1, 2)
    start = replace(there, error=error, hypothesis=joint.hypothesis(theta, kept))
    low, high = (ends - theta[kept, None]).T
    sizes, step = objective.solve(start, slope[:, :, kept], low, high, damping)
    solved = np.clip(theta[kept] + step, *ends.T)
    return _Alone(objective.adapted(error, sizes), step, low, high, solved, sizes)


def _foretold(
    joint: _Joint,
    there: Assessed,
    slope: Float[np.ndarray, "sample dof law"],
    theta: Theta,
    kept: list[int],
) -> float:
    """Log-likelihood of each recording by what the others say of some of the laws, by the slopes.

    Many laws fit whatever a machine does in one motion; what is its own, another motion has too.
    Parts of the only recording stand in for recordings. Of a law that the others hardly excite
    they say nothing: there it is as all of them have it.
    """
    channels, fit = joint.objective.channels, _alone(joint, there, slope, theta, kept, _DAMPINGS[0])
    own, left = slope[:, :, kept], np.zeros_like(fit.left)
    weights = np.where(channels.valid, channels.precision(there.variance), 0.0)
    whole = np.einsum("nd,ndi->i", weights, own**2)
    for part in parts_of(joint.objective):
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


def _needed(
    joint: _Joint, there: Assessed, slope: Float[np.ndarray, "sample dof law"], theta: Theta
) -> tuple[float, list[int]]:
    """Laws that are left once what says least beside the others has gone, one by one.

    Of those that say the same the least usual goes first. So many go as leave the rest at their
    best in recordings that say nothing of their parameters; all, if nothing is better there.

    Returns:
        (merit by the slopes; the laws).
    """

    def usual(i: int) -> int:
        return get_args(Common).index(joint.laws[i].forms[0][0].common)

    def priced(kept: Sequence[int], loglik: float, solved: Theta) -> float:
        fit = replace(there, hypothesis=joint.hypothesis(solved, kept), loglik=loglik)
        return merit(joint.objective, fit)

    def merit_of(kept: Sequence[int]) -> float:
        return priced(kept, *_solved(joint, there, slope, theta, kept))

    def foretold(kept: list[int]) -> float:
        solved = _solved(joint, there, slope, theta, kept)[1]
        return priced(kept, _foretold(joint, there, slope, theta, kept), solved)

    # an encoder's scale is no force, and stands in for some: it only helps to find these
    kept = [i for i, law in enumerate(joint.laws) if not isinstance(law.forms[0][0], OnOutputs)]
    ways = [(merit_of(kept), kept)]
    while kept:
        less = {i: merit_of([k for k in kept if k != i]) for i in kept}
        best = max(less.values())
        close = [i for i in kept if less[i] > best - THRESHOLDS.evident_nats]
        leaves = min(close, key=lambda i: (usual(i), -less[i]))
        kept = [k for k in kept if k != leaves]
        ways.append((less[leaves], kept))
    return max(ways, key=lambda way: foretold(way[1]))
