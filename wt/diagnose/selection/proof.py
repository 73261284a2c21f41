"""Proof on recordings that nothing was fitted to: before, after, and how certain that is."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import bootstrap

from wt.diagnose.recordings.samples import Samples
from wt.diagnose.recordings.stretches import cut
from wt.diagnose.result import Error, Proof
from wt.diagnose.selection.holdout import Holdout, block_sums, errors
from wt.physics.planted import Hypothesis
from wt.physics.rollout import Replayer
from wt.physics.units import units_at
from wt.types import Location

HORIZONS_S = (0.1, 0.25, 0.5, 1.0, 2.0)
_RESAMPLES = 1000


def prove(
    holdout: Holdout,
    hypothesis: Hypothesis,
    step: float,
    split: str,
    seed: int = 0,
    files: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> Proof:
    """Compare the given and the patched model on held-out recordings.

    Args:
        holdout: the recordings.
        hypothesis: what was found.
        step: physics step of replays [s].
        split: how the recordings were chosen, in words.
        seed: of the interval.
        files: errors, (N, nv), of plain replays of the model as given, of the written files
            together, and of the written MJCF alone; without them, the search's own are taken.
    """
    before, after = files[:2] if files else errors(holdout, [(), hypothesis], step)
    alone = files[2] if files else after
    noise = np.nan_to_num(holdout.smoothed.noise)
    scene = holdout.smoothed.motion.scene
    used = [j for j in range(len(scene.joints)) if np.isfinite(holdout.measured[:, j]).any()]
    overall = _error(before[:, used], after[:, used], noise[used], holdout.block, seed)
    per_joint = {
        scene.joints[j]: _error(before[:, [j]], after[:, [j]], noise[[j]], holdout.block, seed)
        for j in used
    }
    model_only = _error(before[:, used], alone[:, used], noise[used], holdout.block, seed)
    ahead = {h: _ahead(holdout, hypothesis, step, h) for h in HORIZONS_S}
    of_unit = defaultdict[str, list[int]](list)
    for j in used:
        of_unit[units_at(scene, Location("joint", scene.joints[j])).position].append(j)
    horizons = {
        unit: {h: _before_after(errors[:, :, which]) for h, errors in ahead.items()}
        for unit, which in of_unit.items()
    }
    return Proof(overall, per_joint, horizons, split=split, model_only=model_only)


def _error(
    before: Float[np.ndarray, "sample joint"],
    after: Float[np.ndarray, "sample joint"],
    noise: Float[np.ndarray, " joint"],
    block: Int[np.ndarray, " sample"],
    seed: int,
) -> Error:
    a, b = block_sums(before**2, block), block_sums(after**2, block)
    count = block_sums(np.isfinite(before).astype(float), block)
    rms = [float(np.sqrt(x.sum() / max(count.sum(), 1.0))) for x in (a, b)]
    ratio = rms[1] / max(rms[0], 1e-12)
    interval = (ratio, ratio)
    if len(a) >= 4 and np.isfinite(b).all():
        resampled = bootstrap(
            (a, b),
            lambda x, y, axis=-1: np.sqrt(y.sum(axis=axis) / np.maximum(x.sum(axis=axis), 1e-30)),
            paired=True,
            vectorized=True,
            n_resamples=_RESAMPLES,
            method="percentile",
            rng=np.random.default_rng(seed),
        ).confidence_interval
        interval = (float(resampled.low), float(resampled.high))
    floor = float(np.sqrt(np.mean(noise**2)))
    return Error(rms[0], rms[1], floor, ratio, interval)


def _ahead(
    holdout: Holdout, hypothesis: Hypothesis, step: float, horizon: float
) -> Float[np.ndarray, "2 sample joint"]:
    """Errors of replays restarted every ``horizon`` seconds, before and after."""
    stretches, measured = [], []
    for i, s in enumerate(holdout.smoothed.samples):
        for first, last in _windows(s, horizon):
            stretches.append(cut(holdout.smoothed, i, slice(first, last)))
            measured.append(s.q[first:last])
    q = (
        Replayer(holdout.smoothed.motion.scene, stretches, step)
        .run([(), holdout.here(hypothesis)])
        .q
    )
    late = np.concatenate([np.arange(len(m)) > 0 for m in measured])
    error: np.ndarray = (q - np.concatenate(measured))[:, late]
    return error


def _before_after(errors: Float[np.ndarray, "2 sample joint"]) -> tuple[float, float]:
    before, after = np.sqrt(np.nanmean(errors**2, axis=(1, 2)))
    return float(before), float(after)


def _windows(s: Samples, horizon: float) -> list[tuple[int, int]]:
    """Windows of a length, spread over a segment; about two over any moment, at most 60."""
    size = max(2, round(horizon / s.dt) + 1)
    count = int(np.clip(2 * len(s.t) // size, 1, 60))
    starts = np.unique(np.linspace(0, max(len(s.t) - size, 0), count).astype(int))
    return [(int(i), int(min(i + size, len(s.t)))) for i in starts]
