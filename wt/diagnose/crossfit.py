"""Proof of an effect that the held-out recordings do not excite: fitted ones left out in turn.

A slow held-out motion says nothing of a rotor's inertia, however clearly fast ones showed it. Then
everything is fitted again without some of the fitted data, and judged on those.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wt.diagnose.assessed import Hypothesis, without
from wt.diagnose.objective import Objective
from wt.diagnose.proof import (
    RAN_AWAY,
    SIGNIFICANT,
    Gain,
    Held,
    blocks_of,
    gain_of,
    gains,
    scaled,
)
from wt.diagnose.refine import refine

Array = np.ndarray

WORTH = 0.1
"""Smallest share of the squared error that it must remove: the search has seen these data."""
SELDOM = 0.05
"""Held-out data that an effect changes by less than this share of what it changes fitted ones by
cannot say: a machine that stands tells little of what slows it down."""
PARTS = 4
"""A single recording is divided into so many parts."""


def where_mute(
    objective: Objective,
    held: Held,
    hypothesis: Hypothesis,
    full: Hypothesis,
    found: Sequence[Gain],
    step: float,
) -> list[Gain]:
    """Gains on held-out data, but on fitted ones where those cannot say.

    Args:
        objective: replays of all fitted data, linear around the hypothesis.
        held: held-out recordings.
        hypothesis: the effects.
        full: the same, and after them corrections of what any rig is off by.
        found: gain of each effect over all others, with corrections of their own.
        step: physics step of replays [s].
    """
    found = list(found)
    unproven = [i for i, g in enumerate(found) if g.p_value > SIGNIFICANT]
    # corrections make up for what is missing, and differ: an effect itself may change less
    alone = gains(held, full, [without(full, i) for i in unproven], step) if unproven else []
    for i, changed in zip(unproven, alone, strict=True):
        found[i] = replace(found[i], potential=changed.potential)
    asked = [i for i in unproven if found[i].undecided or found[i].potential < SELDOM]
    for i in asked:
        fitted, here = left_in_turn(objective, hypothesis, i), found[i]
        if here.undecided or here.potential < SELDOM * fitted.potential:
            p_value = min(1.0, fitted.p_value * len(asked)) if fitted.share >= WORTH else 1.0
            found[i] = replace(here, p_value=p_value, in_turn=True)
    return found


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
