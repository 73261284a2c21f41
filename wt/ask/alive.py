"""The hypotheses that recordings leave: what a diagnosis claims, and what it may be confused with.

Each is fitted to the same recordings, so that an experiment is judged by the machines that these
allow, and not by how one would be guessed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.pipeline import Outcome
from wt.diagnose.result import Estimate
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
    """

    hypothesis: Hypothesis
    spread: Float[np.ndarray, " parameter"]
    differs: Planted | None = None


def alive(outcome: Outcome) -> tuple[Alive, ...]:
    """What is claimed, then the same with an effect's rival in its place, for each rival.

    What happened at moments of its own is no part of them: an experiment has other moments.
    """
    claims, objective = outcome.claims, outcome.naming.objective
    claimed = claims.estimated.hypothesis
    kept = [i for i, p in enumerate(claimed) if not p.observed()]
    base = tuple(claimed[i] for i in kept)
    spread = _spread(base, [claims.estimated.estimates[i] for i in kept])
    found = [Alive(base, spread)]
    for place, i in enumerate(kept):
        for rival in claims.accepted[i].rivals:
            others = base[:place] + base[place + 1 :]
            if rival.observed() or rival.key in {p.key for p in others}:
                continue
            fitted = estimate(objective, (*base[:place], rival, *base[place + 1 :]))
            found.append(
                Alive(
                    fitted.hypothesis,
                    _spread(fitted.hypothesis, fitted.estimates),
                    fitted.hypothesis[place],
                )
            )
    return tuple(found)


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
