"""Which level a parameter belongs to: the model, the unit, the session or the load.

A parameter was estimated in groups (a unit, a session, a load), each with a standard error that is
known. It is modelled as nested random effects: the model's value + the unit's deviation + the
session's deviation within its unit + what a load adds + the estimate's own error. Heterogeneity is
tested by Cochran's Q (W. G. Cochran, 1954), between sessions of a unit first, then between units
over what sessions differ by; variances are those of the method of moments (R. DerSimonian and N.
Laird, 1986), with intervals by Q profiles (W. Viechtbauer, 2007). Left-out units and sessions are
predicted from the others. Everything here is arithmetic on arrays: no files, no machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import binom, chi2, f

from wt.data.labels import UNLOADED, Labels
from wt.passport.scatter import TAIL, Known, Scattered, fit, interval, pooled, profile, quantile

Level = Literal["model", "load", "unit", "session", "unexplained"]
"""The highest level at which a parameter has one value: everywhere; under each load; on each unit
(whatever the load adds); in each session; or at none of them."""

CHANCE = 0.01
"""Probability that a parameter of the model is put anywhere else, over its tests together."""
_UNPREDICTED = 1e-3
"""Probability of so many wrong predictions of what was left out, below which no level explains a
parameter. They share what they are predicted from, so that it is smaller than that of the tests."""


@dataclass(frozen=True)
class HeterogeneityTest:
    """A test of whether values differ by more than their errors.

    Attributes:
        statistic: Q, or F where what sessions differ by had to be estimated.
        freedom: degrees of freedom; of the denominator too where it is an F.
        p: probability of one as large if the values were the same.
    """

    statistic: float
    freedom: tuple[int, ...]
    p: float


@dataclass(frozen=True)
class HeldOut:
    """How well values are predicted that nothing was fitted to.

    Attributes:
        what: what is left out at a time.
        count: how many were left out, one after another.
        inside: how many lie in the 95 % interval of their prediction.
    """

    what: Literal["unit", "session"]
    count: int
    inside: int

    @property
    def p(self) -> float:
        """Probability of as few inside by chance."""
        missed = self.count - self.inside
        return float(binom.sf(missed - 1, self.count, 2.0 * (1.0 - TAIL)))


@dataclass(frozen=True, eq=False)
class Sessions:
    """One value a session, loads taken off.

    Attributes:
        keys: (unit, session) of each, in order.
        value: the values.
        error: their standard errors.
    """

    keys: tuple[tuple[str, str], ...]
    value: Float[np.ndarray, " session"]
    error: Float[np.ndarray, " session"]

    @property
    def units(self) -> tuple[str, ...]:
        """Units, in order."""
        return tuple(dict.fromkeys(unit for unit, _ in self.keys))

    @property
    def unit(self) -> Int[np.ndarray, " session"]:
        """Index of each one's unit."""
        units = self.units
        return np.array([units.index(unit) for unit, _ in self.keys])

    def where(self, chosen: Bool[np.ndarray, " session"]) -> Sessions:
        """Some of them."""
        keys = tuple(k for k, c in zip(self.keys, chosen, strict=True) if c)
        return Sessions(keys, self.value[chosen], self.error[chosen])


@dataclass(frozen=True, eq=False)
class Placed:
    """A parameter at its level.

    Attributes:
        level: the highest at which it has one value.
        model: mean over all units.
        units: of each unit; the model's where units do not differ.
        sessions: one value a session, loads taken off.
        loads: what each load adds to the first; empty if loads do not differ, or there is one.
        unit_spread, session_spread: standard deviations between units, and between the sessions
            of a unit; None if there are no two to compare.
        tests: by what they compare: ``load``, ``session``, ``unit``, ``rest``.
        held_out: predictions of what was left out.
        notes: what these data cannot tell.
    """

    level: Level
    model: Known
    units: dict[str, Known]
    sessions: Sessions
    loads: dict[str, Known]
    unit_spread: Known | None
    session_spread: Known | None
    tests: dict[str, HeterogeneityTest]
    held_out: tuple[HeldOut, ...]
    notes: tuple[str, ...]

    @property
    def session_freedom(self) -> int:
        """Degrees of freedom of what sessions differ by."""
        return len(self.sessions.keys) - len(self.sessions.units)


def place(
    labels: Sequence[Labels],
    value: Float[np.ndarray, " group"],
    error: Float[np.ndarray, " group"],
    chance: float = CHANCE,
) -> Placed:
    """Put a parameter at the highest level that explains its estimates.

    Args:
        labels: of each group, all different.
        value: an estimate a group.
        error: its standard error, larger than 0.
        chance: probability that a parameter of the model is put anywhere else.
    """
    loads, tests, notes = _loads(labels, value, error)
    size = _share(tests, labels, chance)
    differ = "load" in tests and tests["load"].p < size
    table = _pooled(labels, value - _added(labels, loads) if differ else value, error)
    rest = _rest(labels, value, error, differ)
    tests |= {"rest": rest} if rest else {}
    within = _within(table)
    if within.freedom:
        tests["session"] = _chi2(within.q(0.0), within.freedom)
    drifting = "session" in tests and tests["session"].p < size
    means = _unit_means(table, within.variance)
    between = _between(means, within.freedom if drifting else None)
    tests |= {"unit": between} if between else {}
    apart = between is not None and between.p < size
    level: Level = "session" if drifting else "unit" if apart else "load" if differ else "model"
    held_out = _held_out(table, apart, drifting)
    if (rest and rest.p < size) or any(h.p < _UNPREDICTED for h in held_out):
        level = "unexplained"
    means = _unit_means(table, within.variance if drifting else 0.0)
    model = _mean(means, apart, len(table.value) - 1 if drifting else None)
    return Placed(
        level=level,
        model=model,
        units=_units(table, means, within.freedom if drifting else None)
        if apart
        else dict.fromkeys(table.units, model),
        sessions=table,
        loads=loads if differ else {},
        unit_spread=profile(means) if means.freedom else None,
        session_spread=profile(within) if within.freedom else None,
        tests=tests,
        held_out=held_out,
        notes=(*notes, *_untold(table)),
    )


def _dummies(index: Int[np.ndarray, " row"]) -> Float[np.ndarray, "row cell"]:
    """A column for each index."""
    return np.eye(int(index.max()) + 1)[index]


def _chi2(q: float, freedom: int) -> HeterogeneityTest:
    return HeterogeneityTest(q, (freedom,), float(chi2.sf(q, freedom)))


# -- loads ----------------------------------------------------------------------------------------


def _loads(
    labels: Sequence[Labels], value: Float[np.ndarray, " group"], error: Float[np.ndarray, " group"]
) -> tuple[dict[str, Known], dict[str, HeterogeneityTest], tuple[str, ...]]:
    """What each load adds to the first, its test, and what cannot be told.

    Loads are compared inside sessions; where none had two of them, between sessions of a unit,
    over what those differ by.
    """
    names = sorted({k.load for k in labels}, key=lambda name: (name != UNLOADED, name))
    if len(names) < 2:
        return {}, {}, ()
    added = np.array([[float(k.load == name) for name in names[1:]] for k in labels])
    cells = _dummies(_index([(k.unit, k.session) for k in labels]))
    units = _dummies(_index([k.unit for k in labels]))
    known = np.diag(error**2)
    for base, between in ((cells, False), (units, True)):
        design = np.concatenate([added, base], axis=1)
        freedom = int(np.linalg.matrix_rank(design)) - int(np.linalg.matrix_rank(base))
        if freedom < len(names) - 1:
            continue
        covariance = known
        if between:
            scatter = fit(value, known, design).variance(cells)
            covariance = known + scatter * cells @ cells.T
        whole, plain = fit(value, covariance, design), fit(value, covariance, base)
        test = _chi2(plain.q - whole.q, freedom)
        found = {
            name: interval(whole.beta[i], whole.covariance[i, i])
            for i, name in enumerate(names[1:])
        }
        return found, {"load": test}, ()
    note = "Loads and units cannot be told apart: no unit carried several loads."
    return {}, {}, (note,)


def _index(keys: Sequence[object]) -> Int[np.ndarray, " row"]:
    order = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    return np.array([order[key] for key in keys])


def _added(labels: Sequence[Labels], loads: dict[str, Known]) -> Float[np.ndarray, " group"]:
    return np.array([loads[k.load].value if k.load in loads else 0.0 for k in labels])


def _share(tests: dict[str, HeterogeneityTest], labels: Sequence[Labels], chance: float) -> float:
    """Chance of each test, by how many there will be (C. E. Bonferroni)."""
    cells = {(k.unit, k.session) for k in labels}
    units = len({k.unit for k in labels})
    count = len(tests) + (len(cells) > units) + (units > 1) + (len(labels) > len(cells))
    return chance / max(count, 1)


def _rest(
    labels: Sequence[Labels],
    value: Float[np.ndarray, " group"],
    error: Float[np.ndarray, " group"],
    differ: bool,
) -> HeterogeneityTest | None:
    """What is left beyond sessions and loads; None if nothing could be."""
    design = _dummies(_index([(k.unit, k.session) for k in labels]))
    if differ:
        design = np.concatenate([design, _dummies(_index([k.load for k in labels]))], axis=1)
    left = fit(value, np.diag(error**2), design)
    return _chi2(left.q, left.freedom) if left.freedom else None


def _pooled(
    labels: Sequence[Labels], value: Float[np.ndarray, " group"], error: Float[np.ndarray, " group"]
) -> Sessions:
    """One value a session, weighted by the errors."""
    keys = tuple(sorted({(k.unit, k.session) for k in labels}))
    mine = np.array([[(k.unit, k.session) == key for k in labels] for key in keys], float)
    weight = mine / error**2
    total = weight.sum(axis=1)
    return Sessions(keys, weight @ value / total, 1.0 / np.sqrt(total))


# -- sessions and units ---------------------------------------------------------------------------


def _within(table: Sessions) -> Scattered:
    """Sessions about their units' means."""
    return Scattered(table.unit, table.value, table.error**2)


def _unit_means(table: Sessions, scatter: float) -> Scattered:
    """Means of units about the mean of all, where sessions scatter by some variance."""
    weight = 1.0 / (table.error**2 + scatter)
    total = np.bincount(table.unit, weight)
    mean = np.bincount(table.unit, weight * table.value) / total
    return Scattered(np.zeros(len(mean), int), mean, 1.0 / total)


def _between(means: Scattered, freedom: int | None) -> HeterogeneityTest | None:
    """Whether units differ; None if there is one.

    Args:
        means: of the units.
        freedom: degrees of freedom of what sessions differ by, where that is significant.
    """
    if not means.freedom:
        return None
    q = means.q(0.0)
    if freedom is None:
        return _chi2(q, means.freedom)
    ratio = q / means.freedom
    p = float(f.sf(ratio, means.freedom, freedom))
    return HeterogeneityTest(ratio, (means.freedom, freedom), p)


def _mean(means: Scattered, apart: bool, freedom: int | None) -> Known:
    """Mean over all units; of units that differ, by how they do."""
    spread = means.variance if apart else 0.0
    return interval(*pooled(means.value, means.known + spread), means.freedom if apart else freedom)


def _units(table: Sessions, means: Scattered, freedom: int | None) -> dict[str, Known]:
    rows = zip(table.units, means.value, means.known, strict=True)
    return {unit: interval(float(mean), float(known), freedom) for unit, mean, known in rows}


# -- what was left out ----------------------------------------------------------------------------


def _held_out(table: Sessions, apart: bool, drifting: bool) -> tuple[HeldOut, ...]:
    """Predictions of each unit from the others, and of each session from the others."""
    found = []
    units = len(table.units)
    if units > 2:
        hits = [_predicts(table, table.unit == i, apart, drifting, True) for i in range(units)]
        found.append(HeldOut("unit", units, sum(hits)))
    alone = np.bincount(table.unit)[table.unit] < 2
    left = [i for i in range(len(table.value)) if not (alone[i] and apart)]
    if len(left) > 2:
        rows = np.arange(len(table.value))
        hits = [_predicts(table, rows == i, apart, drifting, False) for i in left]
        found.append(HeldOut("session", len(left), sum(hits)))
    return tuple(found)


def _predicts(
    table: Sessions,
    left_out: Bool[np.ndarray, " session"],
    apart: bool,
    drifting: bool,
    new_unit: bool,
) -> bool:
    """Whether the mean of what is left out is where the rest predicts it."""
    rest, out = table.where(~left_out), table.where(left_out)
    within = _within(rest)
    scatter = within.variance if drifting else 0.0
    freedom = within.freedom if drifting else None
    if apart and not new_unit:
        rest = rest.where(np.array([key[0] == out.keys[0][0] for key in rest.keys]))
    means = _unit_means(rest, scatter)
    spread = means.variance if apart and new_unit else 0.0
    predicted, variance = pooled(means.value, means.known + spread)
    found, own = pooled(out.value, out.error**2 + scatter)
    width = quantile(means.freedom if spread else freedom)
    return bool(abs(found - predicted) <= width * np.sqrt(variance + own + spread))


def _untold(table: Sessions) -> tuple[str, ...]:
    """What so few units or sessions cannot tell."""
    units, sessions = len(table.units), len(table.value)
    notes = []
    if units == 1:
        notes.append("There is one unit: what is its own may as well be the model's.")
    if sessions == units:
        notes.append("No unit has two sessions: what is a unit's own may be the session's.")
    return tuple(notes)
