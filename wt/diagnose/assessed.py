"""A hypothesis, and how well it replays the recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt.physics.planted import Planted

Array = np.ndarray

Hypothesis = tuple[Planted, ...]


def without(hypothesis: Hypothesis, index: int) -> Hypothesis:
    """All effects but one."""
    return hypothesis[:index] + hypothesis[index + 1 :]


@dataclass(frozen=True, eq=False)
class Assessed:
    """A hypothesis against the recordings.

    Attributes:
        hypothesis: what was replayed.
        loglik: log-likelihood, up to a constant [nats]; −inf if a replay exploded.
        variance: mean square error after the adaptations, (parts, nv): of all samples where
            replays are smooth, of each stretch where feet land.
        nuisance: the adapted errors, in standard deviations.
        centre: those that it was replayed with.
        error: projected error that replays without any nuisance would have, (N, nv).
    """

    hypothesis: Hypothesis
    loglik: float
    variance: Array
    nuisance: Array
    centre: Array
    error: Array

    @property
    def mse(self) -> Array:
        """Mean square error that is typical of each joint, (nv,): geometric over the parts."""
        return np.asarray(np.exp(np.log(self.variance).mean(axis=0)))
