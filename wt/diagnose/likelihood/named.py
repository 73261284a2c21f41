"""Estimates as they are stated: by name, with unit, interval, and what speaks against them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.shown import hidden_axes
from wt.diagnose.result import Estimate
from wt.physics.planted import Planted
from wt.physics.units import Units


def named(
    planted: Planted,
    units: Units,
    low: Float[np.ndarray, " parameter"],
    high: Float[np.ndarray, " parameter"],
    smallest: Float[np.ndarray, " parameter"],
    visible: Float[np.ndarray, "parameter parameter"],
) -> dict[str, Estimate]:
    """What is said of each parameter of an effect.

    Args:
        planted: the effect, fitted.
        units: of its place.
        low: lower ends of its intervals.
        high: upper ends.
        smallest: changes of its parameters that matter.
        visible: projection on the directions that recordings show.
    """
    lower, upper = planted.effect.bounds()
    estimates: dict[str, Estimate] = {}
    for p, rows in planted.effect.rows():
        if not p.public:
            continue
        value, ends, span = planted.theta[rows], (low[rows], high[rows]), (lower[rows], upper[rows])
        if not p.step:
            chosen = _plain(value, bool(p.axes))
            estimates[p.name] = Estimate(chosen, p.unit_in(units), (chosen, chosen))
            continue
        if p.comes_round:
            estimates[p.name] = _turned(value[0], (ends[0][0], ends[1][0]), p.unit_in(units))
            continue
        hidden = hidden_axes(visible[rows, rows]) if p.axes else []
        known = np.setdiff1d(np.arange(p.size), hidden)
        warning = _warning(
            value[known],
            (ends[0][known], ends[1][known]),
            (span[0][known], span[1][known]),
            float(smallest[rows].max()),
        )
        for end, admissible in zip(ends, span, strict=True):
            end[hidden] = admissible[hidden]
        estimates[p.name] = Estimate(
            _plain(value, bool(p.axes)),
            p.unit_in(units),
            (_plain(ends[0], bool(p.axes)), _plain(ends[1], bool(p.axes))),
            warning,
            tuple(p.axes[i] for i in hidden),
        )
    for name, (unit, values) in planted.observed().items():
        estimates[name] = Estimate(values, units.of(unit), (values, values))
    return estimates


def _turned(value: float, ends: tuple[float, float], unit: str) -> Estimate:
    """An angle that comes round, from −π to π, with its interval around it [rad]."""
    half = max(value - ends[0], ends[1] - value)  # the bounds cut one side off at most
    principal = float(np.angle(np.exp(1j * value)))
    warning = "" if half < np.pi else "not identifiable from these recordings: any angle may be it"
    half = min(half, np.pi)
    return Estimate(principal, unit, (principal - half, principal + half), warning)


def _warning(
    value: Float[np.ndarray, " component"],
    ends: tuple[Float[np.ndarray, " component"], Float[np.ndarray, " component"]],
    admissible: tuple[Float[np.ndarray, " component"], Float[np.ndarray, " component"]],
    smallest: float,
) -> str:
    """Why an estimate should not be trusted, given its interval; "" if it should."""
    span = admissible[1] - admissible[0]
    at_bound = (value - admissible[0] < 1e-3 * span) | (admissible[1] - value < 1e-3 * span)
    if at_bound.any() and (np.abs(value) > 1e-3 * span).any():
        return "at the bound of what is admissible: the law may be another one"
    # a vector as a whole: one of its components may well be nothing
    if np.linalg.norm(ends[1] - ends[0]) > 2.0 * max(float(np.linalg.norm(value)), smallest):
        return "not identifiable from these recordings: the interval is wider than the value"
    return ""


def _plain(value: Float[np.ndarray, " component"], vector: bool) -> float | tuple[float, ...]:
    return tuple(float(x) for x in value) if vector else float(value[0])
