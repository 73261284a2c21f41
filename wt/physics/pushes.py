"""Pushes: smooth bumps of a force in time, each with its own height, length and flanks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.optimize import least_squares

from wt.physics.motion import Motion, Segment
from wt.physics.usual import EDGE_S, SMOOTH_S, smoothed

_SHORTEST_S, _LONGEST_S, _GAP_S = 0.1, 1.5, 0.04
_USUAL_S = 2.0
"""Time over which what is usual may change: friction errs with the direction of motion."""
_MOST = 12
"""Pushes of one recording; what has more of them is no push now and then."""
_FITTED = 4 * _MOST
"""Moments that stand out, from which on none is looked at."""
_SELDOM = 0.2
"""Share of the time that all of them take at most."""
CLEAR = 0.6
"""Share of a moment's square, but for its mean, that a push explains."""
_ENOUGH = 1e-4
"""Change of a push's figures, and of what it leaves [shares], at which its fit ends."""
_SEES = 4.0
"""Standard deviations that smoothing sees on either side."""
_SEEN = 0.1
"""Share of its height at which a push begins and ends for people."""


class Push(NamedTuple):
    """One push.

    Attributes:
        recording: index of its recording.
        start, end: middles of its flanks [s].
        flank: length scale of a flank [s]; a long one makes a bump, a short one a box.
        height: largest force [N·m or N].
    """

    recording: float
    start: float
    end: float
    flank: float
    height: float

    def course(self, t: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        """Share of its height that acts at some times [s]."""
        # (tanh((t − start)/flank) − tanh((t − end)/flank)) / 2, which is 1 in the middle
        rise, fall = np.tanh((t - self.start) / self.flank), np.tanh((t - self.end) / self.flank)
        top = np.tanh(0.5 * (self.end - self.start) / self.flank)
        return np.asarray(0.5 * (rise - fall) / top)

    @property
    def window(self) -> tuple[float, float]:
        """When it begins and ends for people [s]."""
        middle, half = 0.5 * (self.start + self.end), 0.5 * (self.end - self.start)
        # course = (cosh a + 1) / (cosh a + cosh x), with a = 2 half/flank and x = 2 away/flank
        a = 2.0 * half / self.flank
        if a > 50.0:  # a box: each flank alone
            away = half + 0.5 * self.flank * np.log(1.0 / _SEEN - 1.0)
        else:
            away = 0.5 * self.flank * np.arccosh((np.cosh(a) + 1.0) / _SEEN - np.cosh(a))
        return middle - float(away), middle + float(away)


def flat(pushes: Sequence[Push]) -> tuple[float, ...]:
    """Pushes as one row of figures, see :func:`of`."""
    return tuple(float(x) for push in pushes for x in push)


def of(shape: Sequence[float]) -> tuple[Push, ...]:
    """Pushes of a row of figures."""
    return tuple(Push(*shape[i : i + 5]) for i in range(0, len(shape), 5))


def pushes(
    motion: Motion, force: Float[np.ndarray, " sample"], level: Float[np.ndarray, " sample"]
) -> list[Push]:
    """Pushes that stand out of a force that is small else; none if there are too many.

    Args:
        motion: whose force it is.
        force: [N·m or N].
        level: from which it stands out, once it is smoothed [N·m or N].
    """
    kept = list[Push]()
    smooth = smoothed(motion, force)
    for s in motion.segments:
        t, x, least = motion.t[s.rows], smooth[s.rows], level[s.rows]
        y = x - median_filter(x, max(3, round(_USUAL_S / s.dt)), mode="nearest")
        edge = round(EDGE_S / s.dt)
        spans = [
            _half(sign * y, span)
            for sign in (1.0, -1.0)
            for span in _spans(sign * y > least, round(_GAP_S / s.dt))
            if edge <= span.start and span.stop <= len(t) - edge
        ]
        if len(spans) > _FITTED:
            return []
        each = [(_fitted(t, x, y, span, s), span) for span in spans]
        clear = [(push, span) for push, span in each if push is not None]
        lengths = [_length(span) for _, span in clear]
        if len(clear) > _MOST or sum(lengths) > _SELDOM * len(x):
            return []
        kept += [push for push, _ in clear]
    return sorted(kept)


def _half(y: Float[np.ndarray, " sample"], span: slice) -> slice:
    """Samples around the peak of a span that have more than half of it."""
    peak = span.start + int(np.argmax(y[span]))
    low = np.flatnonzero(y < 0.5 * y[peak])
    after = int(np.searchsorted(low, peak))
    first = int(low[after - 1]) + 1 if after else 0
    return slice(first, int(low[after]) if after < len(low) else len(y))


def _fitted(
    t: Float[np.ndarray, " sample"],
    x: Float[np.ndarray, " sample"],
    y: Float[np.ndarray, " sample"],
    span: slice,
    segment: Segment,
) -> Push | None:
    """The push in a span of time, by least squares beside a constant; None if it is none.

    Args:
        t: time [s].
        x: smoothed force.
        y: the same, but for what is usual.
        span: that has more than half of the push.
        segment: that is looked at.
    """
    length = max(float(t[span.stop - 1] - t[span.start]), _SHORTEST_S)
    middle = 0.5 * float(t[span.stop - 1] + t[span.start])
    rows = np.flatnonzero(np.abs(t - middle) < 1.5 * length)
    force = x[rows]
    peak = float(y[span][np.argmax(np.abs(y[span]))])
    width = SMOOTH_S / segment.dt
    # all that the filter sees of them: far less than a recording
    first = max(0, int(rows[0]) - int(np.ceil(_SEES * width)))
    near = t[first : int(rows[-1]) + 1 + int(np.ceil(_SEES * width))]

    def push(z: Float[np.ndarray, " 4"]) -> Push:
        half, flank = np.exp(z[1:3])
        ends = float(z[0] - half), float(z[0] + half)
        return Push(segment.recording, *ends, float(flank), float(z[3]))

    def left(z: Float[np.ndarray, " 5"]) -> Float[np.ndarray, " moment"]:
        one = push(z[:4])
        course = gaussian_filter1d(one.course(near), width, truncate=_SEES)[rows - first]
        return np.asarray(one.height * course + z[4] - force)

    start = np.array([middle, np.log(0.4 * length), np.log(0.3 * length), peak, 0.0])
    reach = np.array([length, 2.5, 2.5, 3.0 * abs(peak) + 1e-12, 2.0 * abs(peak) + 1e-12])
    bounds = start - reach, start + reach
    fit = least_squares(left, start, bounds=bounds, x_scale=reach, xtol=_ENOUGH, ftol=_ENOUGH)
    total = float(((force - force.mean()) ** 2).sum())
    one = push(fit.x[:4])
    begin, end = one.window
    clear = 2.0 * fit.cost < (1.0 - CLEAR) * total
    return one if clear and _SHORTEST_S < end - begin < _LONGEST_S else None


def _spans(above: Bool[np.ndarray, " sample"], gap: int) -> list[slice]:
    """Runs, those merged that are closer than a gap."""
    rows = np.flatnonzero(above)
    if not len(rows):
        return []
    breaks = np.flatnonzero(np.diff(rows) > max(gap, 1))
    first, last = np.append(0, breaks + 1), np.append(breaks, len(rows) - 1)
    return [slice(int(rows[a]), int(rows[b]) + 1) for a, b in zip(first, last, strict=True)]


def _length(span: slice) -> int:
    return int(span.stop - span.start)
