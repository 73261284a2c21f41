"""Noise whose neighbouring samples are alike, and how much of it a curve follows.

Filters inside of encoders, vibration and loose couplings make successive errors alike. What is slow
of such noise a curve takes for motion: what it leaves of the samples is smaller, and less alike,
than the noise. Here noise is autoregressive, of first order, with a correlation ρ of neighbouring
samples (its colour): its spectrum is S(ω) = σ² (1 − ρ²) / (1 + ρ² − 2 ρ cos ω), ω in radians a
sample. A spline with a knot every s samples follows what is slower than π / s and leaves the rest,
to within a few per cent of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

_COLOURS = np.linspace(0.0, 0.98, 99)
_LEAST = 0.35
"""Colour below which noise is as good as white: what of a motion the best curve misses is alike by
as much. States are off by up to √((1 + ρ)/(1 − ρ)), 1.4 times as much as of white noise."""
_SURE = 4.0  # deviations of the correlation of white noise, from where it is none
_TELLING = 6.0
"""Least samples a knot of a curve that tells coloured noise from a motion: fewer leave of either
little more than what white noise has."""
_AS_GOOD = 1.02
"""Share by which the errors of a curve of more knots may be larger than the best one's: where a
motion is fast for a while only, fewer miss it."""
_WHITER = 0.12
"""Correlation by which a curve of more knots may leave less alike than noise of a colour would."""
_WHITE_FROM = 3.0  # samples a knot from which on what a curve leaves tells colours apart
_FAR = 3.0  # robust deviations: what is farther off is a jolt that a curve misses
_PART, _MORE = (50, 200), 3.0  # samples of a part; of the median of what is left in each


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a recording's positions and velocities.

    Attributes:
        deviation: of a position sample [rad or m].
        colour: correlation of neighbouring ones; 0 of white noise.
        deviation_v: of a velocity sample, which is white; NaN where none was recorded.
    """

    deviation: Float[np.ndarray, " dof"]
    colour: Float[np.ndarray, " dof"]
    deviation_v: Float[np.ndarray, " dof"]

    def drawn(
        self, count: int, rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, "sample dof"]]:
        """So many samples of it: positions, velocities."""
        white = rng.standard_normal((count, len(self.deviation)))
        q = self.deviation * autoregressive(white, self.colour)
        return q, np.nan_to_num(self.deviation_v) * rng.standard_normal(white.shape)


def autoregressive(
    white: Float[np.ndarray, "sample dof"], colour: Float[np.ndarray, " dof"]
) -> Float[np.ndarray, "sample dof"]:
    """Noise of unchanged variance whose neighbouring samples are correlated by so much, from white.

    Args:
        white: independent samples.
        colour: correlation of each column; one without any stays as it is.
    """
    noise = white.copy()
    for column in np.flatnonzero(colour):
        own, fresh = float(colour[column]), float(np.sqrt(1.0 - colour[column] ** 2))
        # the first is as large as all that follow
        given = np.concatenate([white[:1, column], fresh * white[1:, column]])
        noise[:, column] = lfilter([1.0], [1.0, -own], given)
    return noise


def alike(left: Float[np.ndarray, " sample"]) -> float:
    """Correlation of neighbouring samples, but for jolts; 0 where there is nothing.

    Noise is everywhere as it is: parts in which far more is left are none of it alone.
    """
    size = _FAR * 1.4826 * float(np.median(np.abs(left)))
    cut = np.clip(left, -size, size)
    part = int(np.clip(len(cut) // 4, *_PART))
    starts = np.arange(max(1, (len(cut) - 1) // part)) * part
    squares = 0.5 * (cut[1:] ** 2 + cut[:-1] ** 2)
    own, both = (np.add.reduceat(x, starts) for x in (squares, cut[1:] * cut[:-1]))
    usual = own <= _MORE * np.median(own)
    total = float(own[usual].sum())
    return float(both[usual].sum()) / total if total > 0.0 else 0.0


def colour_of(found: float, spacing: float, count: int) -> float:
    """Colour of noise of which a curve leaves samples that are so much alike.

    Args:
        found: correlation of neighbouring samples that are left.
        spacing: of the curve's knots [samples].
        count: of the samples.

    Returns:
        Correlation of neighbouring samples of the noise; 0 where it may as well be white.
    """
    _, each = _left(_COLOURS, spacing)
    if found <= each[0] + _SURE / np.sqrt(count):
        return 0.0
    colour = float(np.interp(found, each, _COLOURS))
    return colour if colour >= _LEAST else 0.0


def deviation_of(left: float, spacing: float, colour: float) -> float:
    """Deviation of noise of which a curve leaves so much.

    Args:
        left: deviation of what is left; of white noise it would be that of all of it.
        spacing: of the curve's knots [samples].
        colour: of the noise.
    """
    ((share,), _) = _left(np.array([colour]), spacing)
    return float(left * np.sqrt((1.0 - 1.0 / spacing) / share))


def slowest(
    scores: Sequence[float], alikes: Sequence[float], spacings: Sequence[float], count: int
) -> tuple[int, float] | None:
    """Which of some curves of ever fewer knots follows a motion, and coloured noise the least.

    Cross-validation takes noise for white. Of noise whose neighbouring samples are alike a curve of
    fine knots predicts each sample from those beside it, and seems the better for it (N. S. Altman,
    Kernel smoothing of data with correlated errors, 1990). So errors are whitened first, by the
    colour that the curve shows which is best by then, from the one of the fewest knots on: what
    that misses of a motion is alike, too, but far larger than any noise, so that another is better,
    or is gone from what curves of more knots leave, where noise would leave its colour.

    Args:
        scores: of each curve, by cross-validation.
        alikes: correlation of neighbouring samples that each leaves.
        spacings: of its knots [samples].
        count: of the samples.

    Returns:
        (index of the curve; colour of the noise); None where noise may as well be white.
    """
    best = len(scores) - 1
    while best >= 0:
        colour = colour_of(alikes[best], spacings[best], count)
        if not colour or spacings[best] < _TELLING:
            return None
        if _gone(colour, alikes[:best], spacings[:best]):
            best -= 1
            continue
        # mean square of e(k) − ρ e(k − 1)
        whitened = np.array(scores) * (1.0 + colour**2 - 2.0 * colour * np.array(alikes))
        better = int(np.argmax(whitened <= _AS_GOOD * whitened.min()))
        if better >= best:
            return best, colour
        best = better
    return None


def _gone(colour: float, alikes: Sequence[float], spacings: Sequence[float]) -> bool:
    """Whether curves of more knots leave samples that are less alike than noise of a colour."""
    return any(
        found < _left(np.array([colour]), spacing)[1][0] - _WHITER
        for found, spacing in zip(alikes, spacings, strict=True)
        if spacing >= _WHITE_FROM
    )


def _left(
    colour: Float[np.ndarray, " colour"], spacing: float
) -> tuple[Float[np.ndarray, " colour"], Float[np.ndarray, " colour"]]:
    """What a curve leaves of noise: its share of the variance, and how alike neighbours are in it.

    Integrals of S and of S cos ω from π / s to π, over that of S from 0 to π, and over the first.
    """
    cut, steep = np.pi / spacing, (1.0 + colour) / (1.0 - colour)
    above = np.pi - 2.0 * np.arctan(steep * np.tan(0.5 * cut))
    known = np.maximum(colour, 1e-6)
    along = ((1.0 + known**2) * above - (1.0 - known**2) * (np.pi - cut)) / (2.0 * known)
    along = np.where(colour > 0.0, along, -np.sin(cut))
    return above / np.pi, along / above
