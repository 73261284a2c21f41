"""Smooth laws of joints, in which their forces are linear, fitted together by the replays' slopes.

Many are judged at the price of one: slopes in all of them say what any of them would do alone, and
only where that leads is replayed.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.bic import merit
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import jacobian
from wt.diagnose.selection.candidates import excluded
from wt.physics.effect import Effect, Shape, effects
from wt.physics.hooks import OnOutputs, Remembering, shaped
from wt.physics.planted import Hypothesis, Key, Planted
from wt.types import Location

Theta = Float[np.ndarray, " law"]
LawSlopes = Float[np.ndarray, "sample dof law"]

_ROUNDS = 4
"""So often all laws are fitted together, each time linear around what the last one said."""
DAMPINGS = (1e-6, 1e-2, 1.0)
"""Of steps that are tried side by side (Levenberg and Marquardt)."""
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

    @property
    def of_sensor(self) -> bool:
        """True if it is no force: it stands in for some, and only helps to find these."""
        return isinstance(self.forms[0][0], OnOutputs)

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


class Laws(NamedTuple):
    """Laws of some joints beside what is found elsewhere.

    Attributes:
        objective: the replays.
        others: what is found elsewhere.
        each: of the joints.
    """

    objective: Objective
    others: Hypothesis
    each: tuple[Law, ...]

    @property
    def parts(self) -> range:
        """Where the laws are in a hypothesis that has all of them."""
        return range(len(self.others), len(self.others) + len(self.each))

    @property
    def nothing(self) -> Theta:
        """Parameters with which none of them does anything."""
        return np.array([law.nothing for law in self.each])

    def hypothesis(self, theta: Theta, kept: Sequence[int]) -> Hypothesis:
        """What is found elsewhere, and some of the laws."""
        return (*self.others, *(self.each[i].planted(float(theta[i]))[0] for i in kept))

    def some(self, kept: Sequence[int]) -> Laws:
        """Some of the laws."""
        return self._replace(each=tuple(self.each[i] for i in kept))

    def merit_of(self, there: Assessed, kept: Sequence[int], loglik: float, theta: Theta) -> float:
        """Merit of some of the laws, if the log-likelihood is that with such parameters."""
        fit = replace(there, hypothesis=self.hypothesis(theta, kept), loglik=loglik)
        return merit(self.objective, fit)


def laws_of(
    objective: Objective, now: Assessed, dofs: Collection[int], banned: Container[Key]
) -> Laws:
    """All smooth laws of some joints and their drives that may stand beside what is elsewhere.

    Args:
        objective: the replays.
        now: the present hypothesis; laws that it has begin as they are there.
        dofs: degrees of freedom of the joints.
        banned: what must not join.
    """
    others = tuple(p for p in now.hypothesis if objective.scene.dof_at(p.at) not in dofs)
    each = (law for dof in dofs for law in _laws_at(objective, now, dof))
    free = (
        law
        for law in each
        if (law.forms[0][0].id, law.at.kind, law.at.name) not in banned
        and not any(excluded(law.planted(law.start)[0], p) for p in others)
    )
    return Laws(objective, others, tuple(free))


def _laws_at(objective: Objective, now: Assessed, dof: int) -> list[Law]:
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


def together(laws: Laws, there: Assessed, theta: Theta) -> tuple[Assessed, LawSlopes, Theta]:
    """All laws fitted together: the fit, the replays' slopes there, and the parameters.

    Args:
        laws: of some joints.
        there: where they begin.
        theta: their parameters there.
    """
    (slope,) = jacobian(laws.objective, [there], [laws.parts])
    for _ in range(_ROUNDS):
        after, way = stepped(laws, there, slope, theta, range(len(laws.each)))
        gained = after.loglik - there.loglik
        if not gained > 0.0:
            break
        there, theta = after, way
        (slope,) = jacobian(laws.objective, [there], [laws.parts], [slope])
        if gained < _CONVERGED:
            break
    return there, slope, theta


def stepped(
    laws: Laws, there: Assessed, slope: LawSlopes, theta: Theta, kept: Sequence[int]
) -> tuple[Assessed, Theta]:
    """The best replay of some of the laws alone, a step away by the slopes, and its parameters."""
    ways = [solved(laws, there, slope, theta, kept, damping)[1] for damping in DAMPINGS]
    fits = laws.objective.evaluate([laws.hypothesis(way, kept) for way in ways])
    best = max(range(len(ways)), key=lambda k: fits[k].loglik)
    return fits[best], ways[best]


def solved(
    laws: Laws,
    there: Assessed,
    slope: LawSlopes,
    theta: Theta,
    kept: Sequence[int],
    damping: float = DAMPINGS[0],
) -> tuple[float, Theta]:
    """Log-likelihood and parameters of some of the laws alone, by the slopes."""
    objective, kept = laws.objective, list(kept)
    fit = alone(laws, there, slope, theta, kept, damping)
    left = fit.left + slope[:, :, kept] @ fit.step
    variance = objective.channels.variance(objective.channels.sums(left**2))
    said = laws.nothing
    said[kept] = fit.theta
    return objective.channels.nats(variance) - 0.5 * float(fit.sizes @ fit.sizes), said


class Alone(NamedTuple):
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


def alone(
    laws: Laws,
    there: Assessed,
    slope: LawSlopes,
    theta: Theta,
    kept: list[int],
    damping: float,
) -> Alone:
    """The step of some of the laws, the others being nothing."""
    objective = laws.objective
    gone = np.setdiff1d(np.arange(len(theta)), kept)
    error = there.error + slope[:, :, gone] @ (laws.nothing - theta)[gone]
    ends = np.array([law.ends() for law in laws.each])[kept].reshape(-1, 2)
    start = replace(there, error=error, hypothesis=laws.hypothesis(theta, kept))
    low, high = (ends - theta[kept, None]).T
    sizes, step = objective.solve(start, slope[:, :, kept], low, high, damping)
    said = np.clip(theta[kept] + step, *ends.T)
    return Alone(objective.adapted(error, sizes), step, low, high, said, sizes)
