"""Recordings beside their replays, for pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from wt.diagnose.evidence import Trace
from wt.diagnose.recordings.prepare import Prepared
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.recordings.stretches import cut
from wt.diagnose.residual.signature import elsewhere, without
from wt.physics.planted import Hypothesis
from wt.physics.rollout import Replayer


def traces(
    prepared: Prepared, smoothed: Sequence[Smoothed], hypothesis: Hypothesis, step: float
) -> tuple[Trace, ...]:
    """One trace for each segment, held-out ones first.

    Args:
        prepared: names of the recordings.
        smoothed: the fitted and the held-out recordings, in this order.
        hypothesis: the findings.
        step: physics step of the replays [s].
    """
    shown = []
    for role, motions in (("holdout", smoothed[1]), ("fit", smoothed[0])):
        scene = motions.motion.scene
        stretches = [cut(motions, i, slice(0, len(s.t))) for i, s in enumerate(motions.samples)]
        here = hypothesis
        if role == "holdout":  # what happens at times happens at theirs
            here = elsewhere(motions.motion, hypothesis)
        both = Replayer(scene, stretches, step).run([(), here]).q
        after = without(motions.motion, here).unexplained
        start = 0
        for s, state, segment in zip(
            motions.samples, motions.at_samples, motions.motion.segments, strict=True
        ):
            rows = slice(start, start + len(s.t))
            start = rows.stop
            grid = motions.motion.t[segment.rows]
            each = slice(None, None, motions.commands)  # commands that were filled in have no row
            shown.append(
                Trace(
                    name=prepared.names[s.recording],
                    role="holdout" if role == "holdout" else "fit",
                    t=s.t[each],
                    recorded=s.q[each],
                    before=both[0, rows][each],
                    after=both[1, rows][each],
                    velocity=state[1][each],
                    force_before=_at(s.t[each], grid, motions.motion.unexplained[segment.rows]),
                    force_after=_at(s.t[each], grid, after[segment.rows]),
                    command={
                        scene.model.actuator(i).name: s.command[each, i]
                        for i in range(s.command.shape[1])
                    },
                )
            )
    return tuple(shown)


def _at(
    t: Float[np.ndarray, " sample"],
    grid: Float[np.ndarray, " grid"],
    values: Float[np.ndarray, "grid dof"],
) -> Float[np.ndarray, "sample dof"]:
    """Values on a grid of times, interpolated to samples."""
    columns = [np.interp(t, grid, values[:, j]) for j in range(values.shape[1])]
    return np.stack(columns, axis=1)
