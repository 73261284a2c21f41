"""Values that differ by more than their errors: least squares, and variances by moments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import brentq
from scipy.stats import chi2, norm
from scipy.stats import t as student

TAIL = 0.975
"""Probability below the upper end of a 95 % interval."""
_LEAST_SHARE = 1e-12  # of all weight: what is less is rounding
_WIDEST = 1e6  # times the largest variance there is: beyond it a spread has no upper end


class Known(NamedTuple):
    """A figure with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Fitted:
    """Generalised least squares.

    Attributes:
        beta: coefficients.
        covariance: theirs.
        q: weighted sum of squares that is left.
        freedom: degrees of freedom that it has.
        projector: P, of which q = y'Py.
    """

    beta: Float[np.ndarray, " column"]
    covariance: Float[np.ndarray, "column column"]
    q: float
    freedom: int
    projector: Float[np.ndarray, "row row"]

    def variance(self, cells: Float[np.ndarray, "row cell"]) -> float:
        """Variance of random effects of cells, by moments: E q = freedom + variance · tr Z'PZ."""
        trace = float(np.einsum("ic,ij,jc->", cells, self.projector, cells))
        return max(0.0, (self.q - self.freedom) / trace) if trace > 1e-12 else 0.0


def fit(
    y: Float[np.ndarray, " row"],
    covariance: Float[np.ndarray, "row row"],
    design: Float[np.ndarray, "row column"],
) -> Fitted:
    """Generalised least squares.

    Args:
        y: values.
        covariance: of their errors.
        design: a column for each coefficient; columns may depend on each other.
    """
    weight = np.linalg.inv(covariance)
    known = np.linalg.pinv(design.T @ weight @ design, hermitian=True)
    beta = known @ design.T @ weight @ y
    left = y - design @ beta
    projector = weight - weight @ design @ known @ design.T @ weight
    freedom = len(y) - int(np.linalg.matrix_rank(design))
    return Fitted(beta, known, max(float(left @ weight @ left), 0.0), freedom, projector)


@dataclass(frozen=True, eq=False)
class Scattered:
    """Values that scatter about the means of their cells, by more than their errors.

    Attributes:
        cell: index of each value's cell.
        value: the values.
        known: variance of their errors.
    """

    cell: Int[np.ndarray, " row"]
    value: Float[np.ndarray, " row"]
    known: Float[np.ndarray, " row"]

    @property
    def freedom(self) -> int:
        """Degrees of freedom about the means."""
        return len(self.value) - len(np.unique(self.cell))

    @property
    def variance(self) -> float:
        """That beyond the errors, by moments."""
        weight = 1.0 / self.known
        total, squares = np.bincount(self.cell, weight), np.bincount(self.cell, weight**2)
        trace = float((total - squares / np.maximum(total, 1e-300)).sum())
        # of each cell one value alone may be known: then nothing is compared
        compared = self.freedom and trace > _LEAST_SHARE * total.sum()
        return max(0.0, (self.q(0.0) - self.freedom) / trace) if compared else 0.0

    def q(self, variance: float) -> float:
        """Weighted sum of squares about the means, were this the variance beyond the errors."""
        weight = 1.0 / (self.known + variance)
        total = np.maximum(np.bincount(self.cell, weight), 1e-300)
        mean = np.bincount(self.cell, weight * self.value) / total
        return float((weight * (self.value - mean[self.cell]) ** 2).sum())


def profile(of: Scattered) -> Known:
    """Standard deviation beyond the errors, with its interval by the profile of Q."""
    widest = _WIDEST * float(of.known.max() + np.ptp(of.value) ** 2)

    def end(probability: float) -> float:
        wanted = float(chi2.ppf(probability, of.freedom))
        if of.q(0.0) <= wanted:
            return 0.0
        if of.q(widest) >= wanted:
            return widest
        return float(brentq(lambda variance: of.q(variance) - wanted, 0.0, widest))

    return Known(*(float(np.sqrt(v)) for v in (of.variance, end(TAIL), end(1.0 - TAIL))))


def pooled(
    value: Float[np.ndarray, " row"], variance: Float[np.ndarray, " row"]
) -> tuple[float, float]:
    """Weighted mean and its variance."""
    weight = 1.0 / variance
    return float((weight * value).sum() / weight.sum()), float(1.0 / weight.sum())


def quantile(freedom: int | float | None) -> float:
    """Half width of a 95 % interval in standard errors."""
    return float(norm.ppf(TAIL) if freedom is None else student.ppf(TAIL, max(freedom, 1)))


def interval(value: float, variance: float, freedom: int | float | None = None) -> Known:
    """A figure with its interval, from the variance of its error.

    Args:
        value: the figure.
        variance: of its error.
        freedom: degrees of freedom that the variance was estimated by; None if it is known.
    """
    half = quantile(freedom) * float(np.sqrt(max(variance, 0.0)))
    return Known(float(value), float(value) - half, float(value) + half)


def two_sided(distance: float, freedom: int | float | None = None) -> float:
    """Probability of as large a distance from nothing by chance, in standard errors."""
    tail = norm.sf(distance) if freedom is None else student.sf(distance, max(freedom, 1))
    return float(2.0 * tail)
