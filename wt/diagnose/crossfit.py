"""Proof of an effect that the held-out recordings do not excite: fitted ones left out in turn.

A slow held-out motion says nothing of a rotor's inertia, however clearly fast ones showed it. Then
everything is fitted again without some of the fitted data, and judged on those.
"""

from __future__ import annotations

import numpy as np

from wt.diagnose.assessed import Hypothesis, without
from wt.diagnose.objective import Objective
from wt.diagnose.proof import RAN_AWAY, Gain, blocks_of, gain_of, scaled
from wt.diagnose.refine import refine

Array = np.ndarray

WORTH = 0.1
"""Smallest share of the squared error that it must remove: the search has seen these data."""
PARTS = 4
"""A single recording is divided into so many parts."""


def left_in_turn(objective: Objective, hypothesis: Hypothesis, index: int) -> Gain:
    """Gain of one effect on fitted data that had no part in the fit of its parameters.

    Args:
        objective: replays of all fitted data, linear around the hypothesis.
        hypothesis: the effects.
        index: of the effect in question.
    """
    pair = [hypothesis, without(hypothesis, index)]
    free = [range(len(h)) for h in pair]
    errors = np.full((2, *objective.measured.shape), np.nan)
    for part in _parts(objective):
        fits = refine(objective.only(~part), pair, free, iterations=2)
        # what the rig is off by is said by the other data too
        again = objective.evaluate([f.hypothesis for f in fits], [f.nuisance for f in fits])
        for error, whole, fit in zip(errors, again, fits, strict=True):
            error[part] = objective.adapted(whole.error, fit.nuisance)[part]
    errors = np.where(objective.channels.valid, np.nan_to_num(errors, nan=RAN_AWAY), np.nan)
    full, less = scaled(errors, objective.noise)
    return gain_of(less, full, blocks_of(objective.recording, objective.t))


def _parts(objective: Objective) -> list[Array]:
    """Rows of each part, (N,) bool: recordings, or stretches of time of the only one."""
    recordings = np.unique(objective.recording)
    if len(recordings) > 1:
        return [objective.recording == r for r in recordings]
    part = PARTS * (objective.t - objective.t.min()) / (np.ptp(objective.t) + 1e-9)
    return [part.astype(int) == k for k in range(PARTS)]
