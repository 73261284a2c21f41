"""Machine code that integrates the paths of loads that move inside a body."""

from __future__ import annotations

import numpy as np

from wt.physics.compiled import fast


def _stepped(
    pulls: np.ndarray,
    h: np.ndarray,
    parts: int,
    centres: np.ndarray,
    half: np.ndarray,
    damping: np.ndarray,
    spring: np.ndarray,
    rolling: np.ndarray,
    path: np.ndarray,
) -> None:
    """Integrate L loads along P pieces of recordings, each from rest in its middle.

    Args:
        pulls: what accelerates a load, but for spring and damping, of (where it is, how fast, one),
            at each step, (steps, P, 7, 3).
        h: length of a piece's steps, (P,) [s].
        parts: steps from one sample to the next.
        centres: middles of the loads' travels, (L, 3) [m].
        half: half of these, (L, 3) [m].
        damping: per mass, (L,) [1/s].
        spring: per mass, (L,) [1/s²].
        rolling: share of its mass that a load's rotation adds, (L,).
        path: away from the middle and velocity at each sample after the first, written,
            (P, 2, n, L, 3) [m, m/s].
    """
    state, pull = np.ones(7), np.empty(3)
    for p in range(len(h)):
        for i in range(len(centres)):
            # what brakes is implicit: stable however strong it is
            gain = h[p] / (1.0 + rolling[i])
            kept = 1.0 / (1.0 + gain * damping[i])
            pushed = gain * kept
            for j in range(3):
                state[j], state[3 + j] = centres[i, j], 0.0
            for k in range(len(pulls)):
                for j in range(3):
                    pull[j] = 0.0
                    for m in range(7):
                        pull[j] += state[m] * pulls[k, p, m, j]
                for j in range(3):
                    away = state[j] - centres[i, j]
                    v = kept * state[3 + j] + pushed * (pull[j] - spring[i] * away)
                    free = away + h[p] * v
                    stopped = min(max(free, -half[i, j]), half[i, j])
                    state[j] = centres[i, j] + stopped
                    state[3 + j] = v if stopped == free else 0.0
                if (k + 1) % parts == 0:
                    for j in range(3):
                        path[p, 0, (k + 1) // parts, i, j] = state[j] - centres[i, j]
                        path[p, 1, (k + 1) // parts, i, j] = state[3 + j]


stepped = fast(_stepped)
