"""Errors of replays at moments: what a model is off by shows whenever the machine moves likewise.

What a model is off by is the same at all times, and its errors come by all degrees. Where nothing
but noise is left most of the time, and in other half seconds, in which the machine moves no more,
replays err by far more and hardly ever by something in between, then something acted that was not
there before, however small it is beside the motion: a brake that drags for a while, say. Each half
second counts by its own error, since else tolerances would bend to what acts at moments, and make
up for a part of it at all times.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.recordings.stretches import WINDOW_S
from wt.diagnose.thresholds import THRESHOLDS

_FEW = 0.5  # share of the samples of the fullest: half seconds with fewer are too short to tell


def windows(objective: Objective) -> Int[np.ndarray, " sample"]:
    """Index of the half second of a stretch that each sample belongs to."""
    label = np.stack([objective.of_stretch, (objective.t / WINDOW_S).astype(int)], axis=1)
    return np.asarray(np.unique(label, axis=0, return_inverse=True)[1].ravel())


def momentary(objective: Objective, assessed: Assessed) -> dict[str, float]:
    """Joints whose replays err far more at some moments than tolerances can.

    Args:
        objective: replays.
        assessed: a hypothesis, as they say.

    Returns:
        Joint → for how long [s]. Nothing is said of a machine that remembers how it began, whose
        replays err the more the longer they last: what acts on it at moments are events.
    """
    if not objective.forgets:
        return {}
    window, valid = windows(objective), objective.channels.valid
    ends = [0, *(np.flatnonzero(np.diff(window)) + 1).tolist(), len(window)]
    parts = tuple(slice(a, b) for a, b in pairwise(ends))
    each = objective.judged(objective.channels.each(parts))
    now = each.reference(assessed.hypothesis, assessed.tolerances)
    left = np.where(valid, each.left(now), 0.0) ** 2
    rig = np.where(valid[:, :, None], each.columns, 0.0) ** 2
    sums = (_sums(parts, x) for x in (left, rig.sum(axis=2), valid.astype(float)))
    found = dict[str, float]()
    every = zip(objective.scene.joints, objective.floor**2, *(x.T for x in sums), strict=True)
    for joint, noise, *own in every:
        if lasting := _lasting(noise, *own):
            found[joint] = lasting * WINDOW_S
    return found


def _lasting(
    noise: float,
    left: Float[np.ndarray, " window"],
    rig: Float[np.ndarray, " window"],
    count: Float[np.ndarray, " window"],
) -> int:
    """Half seconds of a joint that err far more than calm ones in which it moves as much.

    0 if they are few, if most are not calm, or if as many are neither.

    Args:
        noise: mean square error that leaves nothing to explain.
        left: sum of squared errors.
        rig: of squared changes by the tolerances.
        count: number of samples.
    """
    told = count > _FEW * count.max()
    error, moved = left[told] / count[told], rig[told] / count[told]
    t = THRESHOLDS
    calm, far = error <= t.moment_calm * noise, error > t.clean**2 * noise
    if not calm.sum() > 0.5 * len(calm):
        return 0
    lasting = int(np.count_nonzero(far & (moved <= np.quantile(moved[calm], t.moment_moved))))
    between = int(np.count_nonzero(~calm & ~far))
    return lasting if lasting >= t.least_moments and lasting > between else 0


def _sums(
    parts: tuple[slice, ...], values: Float[np.ndarray, "sample dof"]
) -> Float[np.ndarray, "window dof"]:
    """Sums over half seconds."""
    return np.stack([values[part].sum(axis=0) for part in parts])
