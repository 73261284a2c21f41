"""A curve through the samples of one joint: a quintic spline, beside what is known or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.interpolate import BSpline, PPoly
from scipy.sparse.linalg import splu

from wt.diagnose.recordings.colour import alike, deviation_of, slowest
from wt.diagnose.recordings.samples import Samples

DEGREE = 5
_KNOTS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)  # samples between knots that are tried
_COARSEST = 0.05  # s between knots: slower than any motion that matters
_PART_S, _PART, _MISSED = 0.1, 50, 1.7
"""Parts of a segment [s], of so many samples at least, in which a curve beside coloured noise
misses a motion: errors, whitened, have so many times the usual mean square there."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A fitted spline of one joint in one segment, beside a response to commands or nothing.

    Attributes:
        spline: what is fitted.
        spacing: of its knots [samples].
        sigma: deviation of a position sample's noise [rad or m].
        sigma_v: of a velocity sample's; NaN without any.
        score: by generalised cross-validation; of the best, where noise is coloured.
        beside: what it is beside; nothing if None.
        knots: times of its knots, from the first sample to the last [s].
        left: deviation from it, were it white: by it positions count beside velocities.
        alike: correlation of neighbouring deviations from it.
        colour: correlation of neighbouring samples' noise; 0 where that is white.
        fast: from when to when it has more knots, and follows noise, since the motion is fast [s].
    """

    spline: BSpline
    spacing: float
    sigma: float
    sigma_v: float
    score: float
    beside: PPoly | None = None
    knots: Float[np.ndarray, " knot"] | None = None
    left: float = np.nan
    alike: float = 0.0
    colour: float = 0.0
    fast: Float[np.ndarray, "part 2"] = field(default_factory=lambda: np.zeros((0, 2)))

    def at(self, t: Float[np.ndarray, " time"], order: int) -> Float[np.ndarray, " time"]:
        """Position or a derivative of it.

        Args:
            t: when [s].
            order: of the derivative.
        """
        value = np.asarray(self.spline(t, order))
        return value if self.beside is None else value + self.beside(t, order)


def choose(s: Samples, joint: int, beside: PPoly | None = None) -> Curve:
    """The curve whose knots generalised cross-validation prefers, or that is best beside colour."""
    tried: list[Curve] = []
    best: Curve | None = None
    seen = s.t[np.isfinite(s.q[:, joint])]
    apart = float(np.median(np.diff(seen))) if len(seen) > 1 else s.dt
    for spacing in _KNOTS:
        if best is not None and spacing * apart > _COARSEST:
            break
        tried.append(fit(s, joint, spacing, 1.0, np.nan, beside))
        if best is None or tried[-1].score < 0.995 * best.score:
            best = tried[-1]
    assert best is not None
    if joint not in s.estimated:  # what was integrated is smooth, whatever it is off by
        best = _beside_colour(s, joint, best, tried)
    if np.isfinite(s.v[:, joint]).mean() < 0.5:
        return best
    again = fit(s, joint, best.spacing, best.left, best.sigma_v, beside, best.knots)
    # of coloured noise more is seen beside positions alone
    if not best.colour:
        return again
    return replace(best, spline=again.spline, sigma_v=again.sigma_v)


def _beside_colour(s: Samples, joint: int, best: Curve, tried: Sequence[Curve]) -> Curve:
    """The best curve, or where noise is coloured the one that follows least of it.

    But where that misses a motion which is fast for a while it has as many knots as the best one.
    """
    known = [c for c in tried if np.isfinite(c.score)]
    ok = np.isfinite(s.q[:, joint])
    found = slowest(
        [c.score for c in known],
        [c.alike for c in known],
        [c.spacing for c in known],
        int(ok.sum()),
    )
    if found is None:
        return best
    index, colour = found
    slow, t = known[index], s.t[ok]
    left = s.q[ok, joint] - slow.at(t, 0)
    sigma = deviation_of(slow.sigma, slow.spacing, colour)
    slow = replace(slow, sigma=sigma, colour=colour, score=best.score)
    fast = _missed(t, left[1:] - colour * left[:-1], slow.spacing * s.dt)
    if not len(fast) or slow.spacing <= best.spacing:
        return slow
    there = ((t >= fast[:, :1]) & (t <= fast[:, 1:])).any(axis=0)
    knots = _spread(s, t, np.where(there, best.spacing, slow.spacing))
    again = fit(s, joint, slow.spacing, 1.0, np.nan, slow.beside, knots)
    return replace(slow, spline=again.spline, knots=knots, fast=fast)


def _missed(
    t: Float[np.ndarray, " sample"], white: Float[np.ndarray, " error"], around: float
) -> Float[np.ndarray, "part 2"]:
    """From when to when errors, whitened, are larger than usual, and so long before and after [s].

    Args:
        t: of the samples [s].
        white: errors of all but the first.
        around: what is taken with it [s].
    """
    count = max(1, int(len(white) / max(_PART, _PART_S / float(np.median(np.diff(t))))))
    edges = np.linspace(0, len(white), count + 1).astype(int)
    size = np.add.reduceat(white**2, edges[:-1]) / np.diff(edges)
    many = np.flatnonzero(size > _MISSED * np.median(size))
    return np.stack([t[edges[many]] - around, t[edges[many + 1]] + around], axis=1)


def fit(
    s: Samples,
    joint: int,
    spacing: float,
    sigma: float,
    sigma_v: float,
    beside: PPoly | None = None,
    inner: Float[np.ndarray, " knot"] | None = None,
) -> Curve:
    """Least squares spline through positions and, if ``sigma_v`` is finite, velocities.

    Args:
        s: a segment.
        joint: of which.
        spacing: of the knots [samples].
        sigma: deviation of positions [rad or m].
        sigma_v: of velocities; NaN to leave them out.
        beside: what the spline is beside.
        inner: times of the knots, if they are not even [s].
    """
    ok = np.isfinite(s.q[:, joint])
    if ok.sum() < 4 * DEGREE:
        return Curve(_constant(s.t, 0.0), spacing, np.nan, np.nan, np.inf)
    t, x, v = s.t[ok], s.q[ok, joint], s.v[:, joint]
    if beside is not None:
        x, v = x - beside(t), v - beside(s.t, 1)
    inner = _inner(s, t, spacing) if inner is None else inner
    knots = np.concatenate([np.repeat(inner[0], DEGREE), inner, np.repeat(inner[-1], DEGREE)])
    design = BSpline.design_matrix(t, knots, DEGREE)
    normal = (design.T @ design) / sigma**2
    right = design.T @ x / sigma**2
    n = design.shape[1]
    with_v = np.isfinite(v)
    if np.isfinite(sigma_v) and with_v.any():
        slope = _derivative(knots, n)
        design_v = BSpline.design_matrix(s.t[with_v], knots[1:-1], DEGREE - 1) @ slope
        normal = normal + (design_v.T @ design_v) / sigma_v**2
        right = right + design_v.T @ v[with_v] / sigma_v**2
    # third differences, as weak as can be: coefficients that no sample supports stay defined
    third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(n - 3, n))
    ridge = 1e-9 * normal.diagonal().max()
    coefficients = splu((normal + ridge * (third.T @ third)).tocsc()).solve(right)
    spline = BSpline(knots, coefficients, DEGREE)
    left = x - design @ coefficients
    free = max(len(t) - n, 1)
    rms = _core_deviation(left) * float(np.sqrt(len(t) / free))
    # GCV = N·RSS / (N − p)², with p the number of coefficients
    score = float(len(t) * (left @ left) / free**2)
    rate = np.nan
    if with_v.any():
        error = v[with_v] - spline(s.t[with_v], 1)
        rate = float(np.sqrt(np.mean(error**2)))
    rms = max(rms, 1e-9)
    return Curve(spline, spacing, rms, rate, score, beside, inner, rms, alike(left))


def _inner(
    s: Samples, t: Float[np.ndarray, " measured"], spacing: float
) -> Float[np.ndarray, " knot"]:
    """Knots so many samples apart from the first to the last of a segment, measured at ``t``.

    They follow the samples and not the clock: between two that are far apart, nothing is known.
    """
    # as many spaces as come nearest, in doubt one fewer
    spaces = max(1, int(np.ceil((len(t) - 1) / spacing - 0.5)))
    index = np.linspace(0.0, len(t) - 1.0, spaces + 1)
    knots = np.interp(index, np.arange(len(t)), t)
    knots[0], knots[-1] = s.t[0], s.t[-1]
    return knots


def _spread(
    s: Samples, t: Float[np.ndarray, " measured"], spacing: Float[np.ndarray, " measured"]
) -> Float[np.ndarray, " knot"]:
    """Knots as :func:`_inner`, but so many samples apart around each of them."""
    along = np.concatenate([[0.0], np.cumsum(1.0 / spacing[1:])])
    spaces = max(1, int(np.ceil(along[-1] - 0.5)))
    knots = np.interp(np.linspace(0.0, along[-1], spaces + 1), along, t)
    knots[0], knots[-1] = s.t[0], s.t[-1]
    return np.asarray(knots)


def _core_deviation(left: Float[np.ndarray, " sample"]) -> float:
    """Standard deviation of the middle 80 %, as of a normal distribution.

    Where a motion is faster than the knots, a few residuals are large that are no noise.
    """
    size = np.sort(np.abs(left))[: max(int(0.8 * len(left)), 1)]
    # variance of a normal distribution cut off at its 80 % quantile: 0.4377
    return float(np.sqrt(np.mean(size**2) / 0.4377))


def _derivative(knots: Float[np.ndarray, " knot"], n: int) -> sparse.spmatrix:
    """Coefficients of the derivative spline from those of the spline, (n − 1, n)."""
    gap = knots[DEGREE + 1 : DEGREE + n] - knots[1:n]
    factor = DEGREE / gap
    return sparse.diags([-factor, factor], [0, 1], shape=(n - 1, n)).tocsc()


def _constant(t: Float[np.ndarray, " sample"], value: float) -> BSpline:
    knots = np.concatenate([np.repeat(t[0], DEGREE + 1), np.repeat(t[-1], DEGREE + 1)])
    return BSpline(knots, np.full(DEGREE + 1, value), DEGREE)
