"""A curve through the samples of one joint: a quintic spline, beside what is known or nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.interpolate import BSpline, PPoly
from scipy.sparse.linalg import splu

from wt.diagnose.recordings.samples import Samples

DEGREE = 5
_KNOTS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)  # samples between knots that are tried
_COARSEST = 0.05  # s between knots: slower than any motion that matters


@dataclass(frozen=True, eq=False)
class Curve:
    """A fitted spline of one joint in one segment, beside a response to commands or nothing."""

    spline: BSpline
    spacing: float
    sigma: float
    sigma_v: float
    score: float
    beside: PPoly | None = None

    def at(self, t: Float[np.ndarray, " time"], order: int) -> Float[np.ndarray, " time"]:
        """Position or a derivative of it.

        Args:
            t: when [s].
            order: of the derivative.
        """
        value = np.asarray(self.spline(t, order))
        return value if self.beside is None else value + self.beside(t, order)


def choose(s: Samples, joint: int, beside: PPoly | None = None) -> Curve:
    """The curve whose knots generalised cross-validation prefers."""
    best: Curve | None = None
    seen = s.t[np.isfinite(s.q[:, joint])]
    apart = float(np.median(np.diff(seen))) if len(seen) > 1 else s.dt
    for spacing in _KNOTS:
        if best is not None and spacing * apart > _COARSEST:
            break
        curve = fit(s, joint, spacing, 1.0, np.nan, beside)
        if best is None or curve.score < 0.995 * best.score:
            best = curve
    assert best is not None
    if np.isfinite(s.v[:, joint]).mean() < 0.5:
        return best
    return fit(s, joint, best.spacing, best.sigma, best.sigma_v, beside)


def fit(
    s: Samples,
    joint: int,
    spacing: float,
    sigma: float,
    sigma_v: float,
    beside: PPoly | None = None,
) -> Curve:
    """Least squares spline through positions and, if ``sigma_v`` is finite, velocities."""
    ok = np.isfinite(s.q[:, joint])
    if ok.sum() < 4 * DEGREE:
        return Curve(_constant(s.t, 0.0), spacing, np.nan, np.nan, np.inf)
    t, x, v = s.t[ok], s.q[ok, joint], s.v[:, joint]
    if beside is not None:
        x, v = x - beside(t), v - beside(s.t, 1)
    inner = _inner(s, t, spacing)
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
    return Curve(spline, spacing, max(rms, 1e-9), rate, score, beside)


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
