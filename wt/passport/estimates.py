"""The same effects, estimated in every group of recordings that belong together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from wt.data.labels import Labels
from wt.diagnose.result import Estimate
from wt.physics.effect import Parameter, alternatives
from wt.physics.planted import Hypothesis, Planted
from wt.types import Kind, Location

_WIDTH = float(norm.ppf(0.975))
"""Half width of a 95 % interval in standard errors."""
_POINTLIKE = 1e-9  # share of the parameter's smallest step: no estimate is known better


@dataclass(frozen=True, order=True)
class Quantity:
    """One parameter of an effect at a place, of which every group has an estimate.

    Attributes:
        effect: id of the effect.
        kind, place: where, as in :class:`wt.types.Location`.
        parameter: its name; a vector's components are ``name.x`` and so on.
        measured_in: its unit of measurement.
    """

    effect: str
    kind: Kind
    place: str
    parameter: str
    measured_in: str

    @property
    def at(self) -> Location:
        """Where."""
        return Location(self.kind, self.place)

    def __str__(self) -> str:
        """As users name it, e.g. ``joint.friction_coulomb/elbow/coulomb``."""
        return f"{self.effect}/{self.place}/{self.parameter}"


@dataclass(frozen=True)
class GroupEstimate:
    """An estimate of one quantity in one group.

    Attributes:
        labels: the group.
        quantity: what.
        value: the estimate.
        error: its standard error.
        neutral: the value at which it is nothing; None if it takes more than that.
        warning: "" or why it is not used.
    """

    labels: Labels
    quantity: Quantity
    value: float
    error: float
    neutral: float | None = None
    warning: str = ""


def common(found: Sequence[Hypothesis]) -> tuple[Hypothesis, tuple[str, ...]]:
    """One hypothesis for all groups: each effect that was found in any of them.

    Of two that cannot stand beside each other, the one stays that was found more often. So it is
    with two at one place that are easily taken for each other, unless a group found both: they are
    two names of one thing, and together neither would be known. Parameters to start from are
    medians over the groups that found it.

    Args:
        found: what was found in each group.

    Returns:
        (the effects; a note for each that was left out).
    """
    each: dict[tuple[str, str, str], list[Planted]] = {}
    for planted in (p for hypothesis in found for p in hypothesis):
        each.setdefault(planted.key, []).append(planted)
    counts = Counter({key: len(same) for key, same in each.items()})
    beside = {frozenset((a.key, b.key)) for h in found for a in h for b in h if a.key != b.key}
    kept: list[Planted] = []
    notes: list[str] = []
    for key, _ in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        mine = _middle(each[key])
        rival = next((k for k in kept if _excluded(k, mine) or _same(k, mine, beside)), None)
        if rival is None:
            kept.append(mine)
            continue
        notes.append(
            f"{mine} was found {_times(counts[key])} and {rival.effect.id} there "
            f"{_times(counts[rival.key])}: beside each other neither would be known, and the "
            "latter is estimated."
        )
    return tuple(sorted(kept, key=lambda p: p.key)), tuple(notes)


def _excluded(one: Planted, other: Planted) -> bool:
    ids = one.effect.id, other.effect.id
    return one.at == other.at and (ids[0] in other.effect.excludes or ids[1] in one.effect.excludes)


def _same(one: Planted, other: Planted, beside: Set[frozenset[tuple[str, str, str]]]) -> bool:
    """Whether two are names of one thing: alike, at one place, and no group has both."""
    alike = one.at == other.at and other.effect.id in alternatives(one.effect.id)
    return alike and frozenset((one.key, other.key)) not in beside


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _middle(same: Sequence[Planted]) -> Planted:
    """The one whose parameters are nearest to the median of all: a possible law, unlike that."""
    thetas = np.stack([p.theta for p in same])
    spread = np.maximum(np.ptp(thetas, axis=0), 1e-12)
    distance = (((thetas - np.median(thetas, axis=0)) / spread) ** 2).sum(axis=1)
    return same[int(distance.argmin())]


def rows(
    labels: Labels, fitted: Sequence[tuple[Planted, Mapping[str, Estimate]]]
) -> tuple[GroupEstimate, ...]:
    """Estimates of one group, scalar by scalar.

    Args:
        labels: the group.
        fitted: each effect with its parameters by name.
    """
    found = []
    for planted, estimates in fitted:
        for p in planted.effect.parameters:
            if p.public and p.name in estimates:
                found += _scalars(labels, planted, p, estimates[p.name])
    return tuple(found)


def _scalars(
    labels: Labels, planted: Planted, p: Parameter, known: Estimate
) -> list[GroupEstimate]:
    values, low, high = (np.atleast_1d(x) for x in (known.value, *known.ci95))
    names = [f"{p.name}.{axis}" for axis in p.axes] or [p.name]
    # an end that a bound has cut off says less than the other one
    half = np.maximum(np.maximum(values - low, high - values), _POINTLIKE * p.step)
    unshown = [axis in known.unshown for axis in p.axes] or [False]
    return [
        GroupEstimate(
            labels=labels,
            quantity=Quantity(
                planted.effect.id, planted.at.kind, planted.at.name, name, known.unit
            ),
            value=float(value),
            error=float(h) / _WIDTH,
            neutral=p.neutral,
            warning="these recordings cannot show it" if hidden else "",
        )
        for name, value, h, hidden in zip(names, values, half, unshown, strict=True)
    ]
