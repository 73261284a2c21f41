"""Proof on fitted data that are left out in turn, where the held-out ones cannot say.

A slow held-out motion says nothing of a rotor's inertia, however clearly fast ones showed it, and a
stop may be hit once. There everything is fitted again without a part of the fitted data and judged
on that part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import Slopes, refine, slopes_at, slopes_of
from wt.diagnose.selection.holdout import (
    RAN_AWAY,
    Gain,
    Holdout,
    blocks_of,
    gain_of,
    gains,
    scaled,
)
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis, without

PARTS = 4
"""A single recording is divided into so many parts."""


def where_mute(
    objective: Objective,
    holdout: Holdout,
    now: Assessed,
    full: Hypothesis,
    given: Sequence[Gain],
    step: float,
) -> list[Gain]:
    """Gains on held-out data, but on fitted ones where those cannot say.

    Args:
        objective: replays of all fitted data, linear around the hypothesis.
        holdout: held-out recordings.
        now: the effects.
        full: the same, and after them corrections of what any rig is off by.
        given: gain of each effect over all others, with corrections of their own.
        step: physics step of replays [s].
    """
    given = list(given)
    unproven = [i for i, g in enumerate(given) if g.p_value > THRESHOLDS.significant]
    # corrections make up for what is missing, and differ: an effect itself may change less
    alone = gains(holdout, full, [without(full, i) for i in unproven], step) if unproven else []
    for i, changed in zip(unproven, alone, strict=True):
        given[i] = replace(given[i], potential=changed.potential)
    asked = [
        i for i in unproven if given[i].undecided or given[i].potential < THRESHOLDS.seldom_excited
    ]
    slopes = slopes_of(now.hypothesis, slopes_at(objective, now)) if asked else {}
    for i in asked:
        fitted, here = left_in_turn(objective, now.hypothesis, i, slopes), given[i]
        if here.undecided or here.potential < THRESHOLDS.seldom_excited * fitted.potential:
            p_value = (
                min(1.0, fitted.p_value * len(asked))
                if fitted.share >= THRESHOLDS.in_turn_share
                else 1.0
            )
            given[i] = replace(here, p_value=p_value, in_turn=True)
    return given


def left_in_turn(objective: Objective, hypothesis: Hypothesis, index: int, slopes: Slopes) -> Gain:
    """Gain of one effect on fitted data that had no part in the fit of its parameters.

    Args:
        objective: replays of all fitted data, linear around the hypothesis.
        hypothesis: the effects.
        index: of the effect in question.
        slopes: of the hypothesis, by which it is fitted to each part.
    """
    pair = [hypothesis, without(hypothesis, index)]
    free = [range(len(h)) for h in pair]
    errors = np.full((2, *objective.measured.shape), np.nan)
    for part in parts_of(objective):
        fits = refine(objective.only(~part), pair, free, iterations=2, known=slopes)
        # what the rig is off by is said by the other data too
        again = objective.evaluate([f.hypothesis for f in fits], [f.tolerances for f in fits])
        for error, refit, fit in zip(errors, again, fits, strict=True):
            error[part] = objective.adapted(refit.error, fit.tolerances)[part]
    errors = np.where(objective.channels.valid, np.nan_to_num(errors, nan=RAN_AWAY), np.nan)
    full, less = scaled(errors, objective.noise)
    return gain_of(less, full, blocks_of(objective.recording, objective.t))


def parts_of(objective: Objective) -> list[Bool[np.ndarray, " sample"]]:
    """Rows of each part of replays: recordings, or stretches of time of the only one."""
    recordings = np.unique(objective.recording)
    if len(recordings) > 1:
        return [objective.recording == r for r in recordings]
    part = PARTS * (objective.t - objective.t.min()) / (np.ptp(objective.t) + 1e-9)
    return [part.astype(int) == k for k in range(PARTS)]
