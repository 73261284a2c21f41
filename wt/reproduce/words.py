"""Cells and sentences that exhibits share: numbers over seeds, and where orders differ."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence

from wt.evaluate.single_step import Errors
from wt.show.text import short


def mean(values: Sequence[float]) -> float:
    """Over seeds; NaN for none."""
    return statistics.fmean(values) if values else math.nan


def spread(values: Sequence[float]) -> str:
    """One value a seed as ``0.123 ± 0.004``; without the second half for one seed."""
    if not values:
        return "–"
    if len(values) == 1:
        return short(values[0])
    return f"{short(mean(values))} ± {statistics.stdev(values):.1g}"


UNITS = {"mse": "MSE", "mse_change": "of change", "physical": "physical"}
"""Units of single-step errors, of the state, of its change and physical, with their columns."""


def keep_errors(numbers: dict[str, list[float]], errors: Errors) -> None:
    """Add one seed's error in each unit to the lists of :data:`UNITS`."""
    for unit in UNITS:
        numbers.setdefault(unit, []).append(float(getattr(errors, unit)))


def in_units(numbers: Mapping[str, Sequence[float]]) -> list[str]:
    """Cells of an error in each unit."""
    return [spread(numbers[unit]) for unit in UNITS]


def order(ours: Mapping[str, float], papers: Mapping[str, float], what: str) -> str:
    """One sentence that compares our order with the paper's, smallest first.

    Args:
        ours: a number by name.
        papers: the paper's; only names of both are compared.
        what: that is ordered, at the beginning of the sentence.
    """
    common = [name for name in papers if name in ours and math.isfinite(ours[name])]
    own = sorted(common, key=lambda name: ours[name])
    theirs = sorted(common, key=lambda name: papers[name])
    if own == theirs:
        return f"{what}: the paper's order, {' < '.join(own)}."
    return f"{what}: {' < '.join(own)}; in the paper {' < '.join(theirs)}."


def gain(plain: Sequence[float], other: Sequence[float]) -> str:
    """Change from the plain error to the other one, seed by seed: ``12 % less ± 3 %``.

    Args:
        plain: errors of the plain method, one a seed.
        other: of the other one, on the same seeds.
    """
    changes = [100.0 * (b / a - 1.0) for a, b in zip(plain, other, strict=True)]
    middle = mean(changes)
    text = f"{abs(middle):.1f} % {'less' if middle < 0 else 'more'}"
    return text + (f" ± {statistics.stdev(changes):.1f} %" if len(changes) > 1 else " (one seed)")
