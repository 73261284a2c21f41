"""Stamps that jitter although the samples were taken evenly, as where a logger is held up.

Intervals may differ because samples were taken so: then stamps are right, and nothing is lost. A
smooth motion tells: by right stamps its neighbours foretell a sample better than by even ones, and
by wrong stamps worse. Where encoders are too coarse to tell, intervals of all lengths are said.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from wt.check.audit import Stage, Subject, register
from wt.check.audits.clock import periods
from wt.check.finding import AuditFinding
from wt.check.signals import WINDOW_S, WINDOW_SAMPLES
from wt.types import Recording

_UNEVEN = 0.8  # of an interval: spread of the middle nine tenths of all intervals
_NOTICED = 0.1  # of an interval, a deviation: less is what clocks have
_LOST = 1.5  # intervals, by which a stamp may miss its place
_AROUND = 25  # samples
_DRIFT = 0.4  # intervals, by which so many miss their places on average only if rows were lost
_DECISIVE = 4.0  # of mean squares by which neighbours miss samples, by other stamps
_LEAST = 40  # samples


@register
class Jitter:
    """Samples stand at the times that their stamps say."""

    kinds: ClassVar[tuple[str, ...]] = ("clock_jitter",)
    stage: ClassVar[Stage] = "pace"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one."""
        recording = subject.recording
        if recording is None:
            return
        even = _even(recording.t)
        if even is not None:
            gain = _gain(recording, even)
            if gain > _DECISIVE:
                yield _found(
                    f"Stamps miss an even pace by {1e3 * float((recording.t - even).std()):.3g} ms "
                    f"(deviation), and that explains {100.0 * (1.0 - 1.0 / gain):.0f} % of how "
                    "unevenly the motion goes: samples were taken every "
                    f"{1e3 * float(np.median(np.diff(even))):.4g} ms, and stamped as they came",
                    _Even(),
                )
                return
            if _right(recording, even):
                return
        dt = np.diff(recording.t) / np.maximum(periods(recording.t), 1.0)
        low, high = np.quantile(dt, [0.05, 0.95])
        if high - low > _UNEVEN * float(np.median(dt)):
            yield _found(
                f"Nine tenths of the intervals are {1e3 * low:.3g} to {1e3 * high:.3g} ms long, "
                f"where the usual one is {1e3 * float(np.median(dt)):.3g} ms"
            )


def _found(said: str, change: _Even | None = None) -> AuditFinding:
    fix = "stamp samples where they are taken, not where they are written"
    return AuditFinding("clock_jitter", ("t",), (), said, fix, change=change)


class _Even:
    """Stamps samples evenly."""

    def __call__(self, recording: Recording) -> Recording:
        """The recording with an even pace; as it is where none can be told."""
        even = _even(recording.t)
        return recording if even is None else replace(recording, t=even)


def _even(t: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"] | None:
    """Stamps of an even pace; None if these are even already, or nobody can tell which is whose.

    Where most intervals are whole numbers of periods, rows of the longer ones were lost.
    """
    between = periods(t)
    places = np.concatenate([[0.0], np.cumsum(between)])
    if between.min() < 1.0:  # two at one place: a logger that was held up, and caught up
        places = np.arange(len(t), dtype=float)
    rate, start = np.polyfit(places, t - t[0], 1)
    even = t[0] + start + rate * places
    if len(t) < _LEAST or (t - even).std() < _NOTICED * rate:
        return None
    drift = uniform_filter1d(t - even, _AROUND)
    if np.abs(t - even).max() > _LOST * rate or np.abs(drift).max() > _DRIFT * rate:
        return None
    return np.asarray(even)


def _gain(recording: Recording, even: Float[np.ndarray, " sample"]) -> float:
    """How much less neighbours miss samples once what stamps are off by is taken into account.

    A ratio of mean squares, of the column that tells most. Nothing of it is fitted, and only the
    slow part of the motion is used: noise that is smooth from sample to sample tells nothing.
    """
    pace = float(np.median(np.diff(even)))
    sigma = max(WINDOW_S / pace, WINDOW_SAMPLES)
    ratios = []
    for column in _smooth(recording):
        missed, _ = _missed(recording.t, column)
        speed = gaussian_filter1d(column, sigma, order=1) / pace
        # at x(even) for x(t), a sample is off by its speed times what its stamp is off by
        due, _ = _missed(recording.t, speed * (even - recording.t))
        left = float(np.mean((missed - due) ** 2))
        if left > 0.0:
            ratios.append(float(np.mean(missed**2)) / left)
    return max(ratios, default=0.0)


def _right(recording: Recording, even: Float[np.ndarray, " sample"]) -> bool:
    """Tell whether by its own stamps neighbours foretell some column so much better."""
    for column in _smooth(recording):
        (own, size), (other, other_size) = (_missed(t, column) for t in (recording.t, even))
        if np.mean(other**2 / other_size) > _DECISIVE * np.mean(own**2 / size):
            return True
    return False


def _smooth(recording: Recording) -> list[Float[np.ndarray, " sample"]]:
    """Columns that change as motions do, without a sample missing."""
    return [
        column
        for name, column in recording.columns.items()
        if name.startswith(("qpos/", "qvel/")) and np.isfinite(column).all()
    ]


def _missed(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> tuple[Float[np.ndarray, " inner"], Float[np.ndarray, " inner"]]:
    """How far the cubic through two samples on either side misses the one between.

    Returns:
        (by how much; the variance of that where samples have noise of variance one).
    """
    n = len(t) - 4
    at, value = ([y[i : n + i] for i in (0, 1, 3, 4)] for y in (t, x))
    here, missed, size = t[2:-2], x[2:-2].copy(), np.ones(n)
    for i in range(4):
        others = [at[j] for j in range(4) if j != i]
        weight = np.prod([(here - o) / (at[i] - o) for o in others], axis=0)
        missed -= weight * value[i]
        size += weight**2
    return missed, size
