"""Whether a unit is no longer what it was, and when it will have reached a limit.

At each new session of a unit every parameter is tested thrice: its value, and that of the last two,
against the pooled earlier ones, for a step, and the slope over all sessions, for a slow change.
How far sessions scatter although nothing changed is measured, on all units' sessions but those that
are judged: by more than the estimates' errors (temperature, supply), or by less, since much of an
error, as that of the machine's masses, is the same in all its sessions. Student's t tests with that
many degrees of freedom follow. The probabilities of one unit's session are judged together by
S. Holm's procedure (1979), so that a session in which nothing changed raises an alarm with a
probability of at most :data:`FALSE_ALARM`. A limit's day is the crossing of the line, with its
interval by E. C. Fieller's theorem (1954), and is foretold only where the slope itself is
significant and sessions lie on a line.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from scipy.stats import f as fisher
from scipy.stats import t as student

from wt.data.labels import day
from wt.passport.levels import Sessions
from wt.passport.scatter import TAIL, Known, interval, two_sided

FALSE_ALARM = 0.01
"""Probability that a session in which nothing changed raises any alarm."""
TESTS = {"step": 0.25, "late": 0.5, "line": 0.25}
"""The tests, with the share of the false alarms that each may raise: most for the last two sessions
together, which are to show what exceeds three errors."""
_LINES = 8  # degrees of freedom from which scatter is taken about lines, not about means
_LEAST = 0.25
"""Sessions are taken to scatter by half of their errors at least, in variance: units may differ in
how much they do."""
_CROOKED = 0.05
"""Probability of sessions as far from a line, below which it foretells nothing."""
_MANY = 1e6  # degrees of freedom, of which t is the normal distribution

K = TypeVar("K", bound=Hashable)
_day = cache(day)


@dataclass(frozen=True)
class Scatter:
    """What sessions of a unit differ by although nothing changed.

    Attributes:
        variance: beyond the estimates' errors.
        freedom: degrees of freedom that it was estimated by; 0 if it could not be.
        share: of errors and this variance together that sessions do differ by; the rest of the
            errors is the same in all sessions of a unit.
    """

    variance: float = 0.0
    freedom: int = 0
    share: float = 1.0

    def between(self, error: Float[np.ndarray, " session"]) -> Float[np.ndarray, " session"]:
        """Variances with which sessions of a unit scatter.

        Args:
            error: standard errors of the estimates.
        """
        return np.asarray(self.share * (error**2 + self.variance))

    def common(self, error: Float[np.ndarray, " session"]) -> float:
        """Variance of what errs alike in all sessions of a unit."""
        return max(0.0, 1.0 - self.share) * float((error**2).mean())

    @property
    def tail(self) -> float:
        """Degrees of freedom of tests and intervals."""
        return float(self.freedom) if self.freedom else _MANY


@dataclass(frozen=True)
class Change:
    """The last sessions of a unit, beside its earlier ones.

    Attributes:
        before, after: their pooled value, and the last ones'.
        days: between the last of the earlier ones and the last.
        p: probability of such a difference if nothing changed.
        left: weighted sum of squares that a step leaves.
        last: how many sessions it is since.
    """

    before: Known
    after: Known
    days: float
    p: float
    left: float
    last: int = 1


@dataclass(frozen=True)
class Trend:
    """The line through all sessions of a unit.

    Attributes:
        slope: change per day.
        last_day: of the last session, as :func:`wt.data.labels.day` counts.
        at_last: the line there.
        covariance: of (value there, slope).
        freedom: degrees of freedom of intervals.
        p: probability of such a slope if nothing changed.
        left: weighted sum of squares that the line leaves.
        spare: sessions beyond the two that make a line.
    """

    slope: Known
    last_day: float
    at_last: float
    covariance: Float[np.ndarray, "2 2"]
    freedom: float
    p: float
    left: float
    spare: int

    @property
    def straight(self) -> bool:
        """Whether the sessions lie about it as they may; a step that is long over does not."""
        if not self.spare:
            return True
        return float(fisher.sf(self.left / self.spare, self.spare, self.freedom)) >= _CROOKED

    def days_until(self, limit: float) -> Known | None:
        """Days from the last session until the line has reached a limit; None if it never does.

        The upper end is infinite where the interval holds slopes that never reach it.
        """
        a, b = self.at_last - limit, self.slope.value
        crossing = -a / b if b else np.inf
        if not 0.0 < crossing < np.inf:
            return None
        squared = float(student.ppf(TAIL, self.freedom)) ** 2
        (va, c), (_, vb) = self.covariance
        # days at which the line's interval holds the limit: (a + b·d)² ≤ t²·variance(d)
        quadratic = np.array(
            [b**2 - squared * vb, 2.0 * (a * b - squared * c), a**2 - squared * va]
        )
        if quadratic[0] <= 0.0:
            return Known(float(crossing), 0.0, np.inf)
        low, high = sorted(np.roots(quadratic).real)
        return Known(float(crossing), max(float(low), 0.0), float(high))


def scatter(
    table: Sessions,
    unit: str,
    begun: Mapping[str, Sequence[str]] | None = None,
    last: int = 1,
) -> Scatter:
    """Scatter between sessions of any unit, by all of them but the last ones of this unit.

    It is taken about each unit's line, so that a slow change is not mistaken for it; about means
    where there are too few sessions for lines; and anew after each change that was told. A value
    that comes again is a bound of the parameter, and says nothing of scatter.

    Args:
        table: all units' sessions, in order.
        unit: whose last sessions are to be judged.
        begun: unit → sessions with which something new began.
        last: how many are judged.
    """
    mine = [i for i, key in enumerate(table.keys) if key[0] == unit]
    once: dict[tuple[str, float], int] = {}
    for i in sorted(set(range(len(table.keys))) - set(mine[-last:])):
        once.setdefault((table.keys[i][0], float(table.value[i])), i)
    if not once:
        return Scatter()
    rows = list(once.values())
    keys = [table.keys[i] for i in rows]
    units = _columns([name for name, _ in keys])
    states = _columns([(name, sum(first <= session for first in (begun or {}).get(name, ())))
                       for name, session in keys])  # fmt: skip
    lines = np.concatenate([states, units * (_days(keys) - _days(keys).mean())[:, None]], axis=1)
    found = _estimated(table.value[rows], table.error[rows], lines)
    if found.freedom < _LINES:
        found = _estimated(table.value[rows], table.error[rows], states)
    return found


def change(mine: Sessions, usual: Scatter, last: int = 1) -> Change | None:
    """The last sessions of a unit against its earlier ones; None if there are no earlier ones.

    Args:
        mine: sessions of one unit, in order.
        usual: scatter between sessions.
        last: how many are the last: two show a change that one did not show for certain.
    """
    if len(mine.value) <= last:
        return None
    variance = usual.between(mine.error)
    parts = slice(None, -last), slice(-last, None)
    means, known, total = np.zeros(2), np.zeros(2), np.zeros(2)
    left = 0.0
    for i, part in enumerate(parts):
        weight = 1.0 / variance[part]
        means[i], total[i] = (weight * mine.value[part]).sum() / weight.sum(), 1.0 / weight.sum()
        known[i] = 1.0 / (1.0 / mine.error[part] ** 2).sum()
        left += float((weight * (mine.value[part] - means[i]) ** 2).sum())
    before, after = map(float, means)
    days = _days(mine.keys)
    return Change(
        before=interval(before, float(total[0]) + usual.common(mine.error[parts[0]]), usual.tail),
        after=interval(after, float(known[1]), _MANY),
        days=float(days[-1] - days[-1 - last]),
        p=two_sided(abs(after - before) / np.sqrt(total.sum()), usual.tail),
        left=left,
        last=last,
    )


def trend(mine: Sessions, usual: Scatter) -> Trend | None:
    """The line through the sessions of a unit; None if there are fewer than three, or no time.

    Args:
        mine: sessions of one unit, in order.
        usual: scatter between sessions.
    """
    days = _days(mine.keys)
    if len(days) < 3 or np.ptp(days) <= 0.0:
        return None
    design = np.stack([np.ones_like(days), days - days[-1]], axis=1)
    variance = usual.between(mine.error)
    covariance = np.linalg.inv(design.T @ (design / variance[:, None]))
    value, slope = covariance @ design.T @ (mine.value / variance)
    common = np.diag([usual.common(mine.error), 0.0])
    return Trend(
        slope=interval(float(slope), float(covariance[1, 1]), usual.tail),
        last_day=float(days[-1]),
        at_last=float(value),
        covariance=covariance + common,
        freedom=usual.tail,
        p=two_sided(abs(float(slope)) / np.sqrt(covariance[1, 1]), usual.tail),
        left=float(((mine.value - design @ [value, slope]) ** 2 / variance).sum()),
        spare=len(days) - 2,
    )


def alarms(
    chances: Mapping[K, float], rate: float = FALSE_ALARM, shares: Mapping[K, float] | None = None
) -> set[K]:
    """Which of the tests of one unit's session raise an alarm, by S. Holm's procedure.

    Args:
        chances: p-values by test.
        rate: probability of any alarm if nothing changed.
        shares: of it, by test, as Y. Benjamini and Y. Hochberg (1997) weigh them; None for equal
            ones. Only their ratios count.
    """
    weight = dict.fromkeys(chances, 1.0) if shares is None else shares
    raised: set[K] = set()
    left = sum(weight[key] for key in chances)
    for key in sorted(chances, key=lambda k: chances[k] / weight[k]):
        if chances[key] > rate * weight[key] / left:
            break
        raised.add(key)
        left -= weight[key]
    return raised


def _days(keys: Sequence[tuple[str, str]]) -> Float[np.ndarray, " session"]:
    return np.array([_day(session) for _, session in keys])


def _columns(names: Sequence[Hashable]) -> Float[np.ndarray, "row name"]:
    """A column for each name."""
    order = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return np.eye(len(order))[[order[name] for name in names]]


def _estimated(
    value: Float[np.ndarray, " session"],
    error: Float[np.ndarray, " session"],
    design: Float[np.ndarray, "session column"],
) -> Scatter:
    """Scatter of sessions about a design."""
    q, trace, freedom = _moments(value, error**2, design)
    if not freedom or trace <= 0.0:
        return Scatter()
    variance = max(0.0, (q - freedom) / trace)  # R. DerSimonian and N. Laird (1986)
    if variance:
        q, _, _ = _moments(value, error**2 + variance, design)
    return Scatter(variance, freedom, max(q / freedom, _LEAST))


def _moments(
    value: Float[np.ndarray, " session"],
    variance: Float[np.ndarray, " session"],
    design: Float[np.ndarray, "session column"],
) -> tuple[float, float, int]:
    """Weighted sum of squares that a design leaves, its trace and its degrees of freedom.

    If every variance were larger by 1, the sum's expectation were larger by the trace.
    """
    root = 1.0 / np.sqrt(variance)
    columns, size, _ = np.linalg.svd(root[:, None] * design, full_matrices=False)
    columns = columns[:, size > 1e-9 * size[0]]
    left = root * value - columns @ (columns.T @ (root * value))
    trace = float((root**2 * (1.0 - (columns**2).sum(axis=1))).sum())
    return float(left @ left), trace, len(value) - columns.shape[1]
