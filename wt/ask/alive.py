"""The hypotheses that recordings leave: what a diagnosis claims, and what it may be confused with.

Each is fitted to the same recordings, so that an experiment is judged by the machines that these
allow, and not by how one would be guessed. Of two laws that fit alike, one of which contains the
other, a diagnosis claims the smaller one: nothing asks for more. A machine that can be asked may
have the larger one all the same (friction that grows with the load, where the load hardly changed).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.estimate import estimate, fitted
from wt.diagnose.pipeline import Outcome
from wt.diagnose.result import Estimate
from wt.diagnose.selection.candidates import lookalikes
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.hooks import shaped
from wt.physics.planted import Hypothesis, Planted

_SIGMAS = 1.96
"""Half a 95 % interval, in standard deviations."""


@dataclass(frozen=True, eq=False)
class Alive:
    """A hypothesis that the recordings leave.

    Attributes:
        hypothesis: effects with their parameters.
        spread: standard deviation of each parameter, one effect after another; zero where it was
            read off the recordings.
        differs: the part that no other hypothesis has; None for what is claimed.
        larger: whether that part contains what is claimed in its place.
    """

    hypothesis: Hypothesis
    spread: Float[np.ndarray, " parameter"]
    differs: Planted | None = None
    larger: bool = False


def alive(outcome: Outcome) -> tuple[Alive, ...]:
    """What is claimed, then the same with an effect's rival in its place, for each rival.

    Then with each larger law that fits as well, but for its price. What happened at moments of its
    own is no part of them: an experiment has other moments.
    """
    claims, objective = outcome.claims, outcome.naming.objective
    claimed = claims.estimated.hypothesis
    kept = [i for i, p in enumerate(claimed) if not p.observed()]
    base = tuple(claimed[i] for i in kept)
    spread = _spread(base, [claims.estimated.estimates[i] for i in kept])
    found = [Alive(base, spread)]
    for place, i in enumerate(kept):
        rivals = [r for r in claims.accepted[i].rivals if not r.observed()]
        tried = [(r, False) for r in rivals] + [
            (p, True) for p in _larger(outcome, base, place) if p.key not in {r.key for r in rivals}
        ]
        for rival, larger in tried:
            others = base[:place] + base[place + 1 :]
            if rival.key in {p.key for p in others}:
                continue
            fit = estimate(objective, (*base[:place], rival, *base[place + 1 :]))
            spread = _spread(fit.hypothesis, fit.estimates)
            found.append(Alive(fit.hypothesis, spread, fit.hypothesis[place], larger))
    return tuple(found)


def _larger(outcome: Outcome, base: Hypothesis, place: int) -> list[Planted]:
    """Laws at a place with more parameters than the one there, fitted, that fit as well.

    Each from the start, of those that the force residual shows and of those that it has from the
    smaller law, from which it comes farthest.
    """
    naming, claimed = outcome.naming, base[place]
    shapes = {a.planted.key: a.shape for a in outcome.claims.accepted}
    known = [(p, shapes.get(p.key)) for p in base if p is not claimed]
    wanted = {
        (name, at)
        for name, at in lookalikes(naming.screen, claimed)
        if at == claimed.at and effects()[name].n_free > claimed.effect.n_free
    }
    ranked = (s for s in naming.screen.rank(known, wanted) if np.isfinite(s.gain))
    starts = [s.planted for s in ranked]
    for name, _ in sorted(wanted, key=str):
        law = effects()[name]
        beyond = claimed.beyond(law, naming.objective.motion)
        starts += [Planted(shaped(law, shape), claimed.at, theta) for shape, theta in beyond]
    best: dict[str, tuple[float, Planted]] = {}
    for start in (p for p in starts if not p.observed()):
        fit = fitted(naming.objective, (*base[:place], start, *base[place + 1 :]))
        name = start.effect.id
        if name not in best or fit.loglik > best[name][0]:
            best[name] = fit.loglik, fit.hypothesis[place]
    least = outcome.claims.estimated.assessed.loglik - THRESHOLDS.equivalent_nats
    return [law for loglik, law in best.values() if loglik > least]


def _spread(
    hypothesis: Hypothesis, estimates: Sequence[Mapping[str, Estimate]]
) -> Float[np.ndarray, " parameter"]:
    """Standard deviations of all parameters, by their intervals; at most half of what may be."""
    deviations = [np.zeros(0)]
    for planted, named in zip(hypothesis, estimates, strict=True):
        lower, upper = planted.effect.bounds()
        own = np.zeros(planted.effect.n_theta)
        for parameter, rows in planted.effect.rows():
            if parameter.name in named:
                low, high = (np.atleast_1d(end) for end in named[parameter.name].ci95)
                half = np.minimum((high - low) / 2.0, (upper - lower)[rows] / 2.0)
                own[rows] = np.nan_to_num(half / _SIGMAS)
        deviations.append(own)
    return np.concatenate(deviations)
