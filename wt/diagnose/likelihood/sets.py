"""Replays of one or more sets of recordings, which are counted through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.steps import Steps
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.recordings.stretches import stretches_of

_TELLING = 0.4
"""Share of a floating machine's windows that are not spread evenly: where forces are unusual."""


def objective_on(
    sets: Sequence[Smoothed],
    forgetting: bool,
    seconds: float,
    step: float,
    window: float | None = None,
    smooth: Steps | None = None,
) -> Objective:
    """Replays of one or more sets of recordings, which are counted through; see ``Objective``."""
    telling = _TELLING if sets[0].motion.scene.free else 0.0
    pairs, before = [], 0
    for smoothed in sets:
        stretches = stretches_of(smoothed, forgetting, seconds, telling, window)
        pairs += [(replace(s, recording=s.recording + before), q) for s, q in stretches]
        before += max(s.recording for s in smoothed.samples) + 1
    return Objective(sets[0], pairs, step, forgetting, smooth)
