"""Whether a unit is no longer what it was, and when it will have reached a limit.

At each new session of a unit every parameter is tested thrice: its value, and that of the last two,
against the pooled earlier ones, for a step, and the slope over all sessions, for a slow change.
Beyond the estimates' errors sessions may differ by a scatter of their own (temperature, supply),
which is estimated on all sessions but that one. The probabilities of one unit's session are judged
together by S. Holm's procedure (1979), so that a session in which nothing changed raises an alarm
with a probability of at most :data:`FALSE_ALARM`. A limit's day is the crossing of the line, with
its interval by E. C. Fieller's theorem (1954), and is foretold only where the slope itself is
significant and sessions lie on a line.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2
from scipy.stats import t as student

from wt.data.labels import day
from wt.passport.levels import Sessions
from wt.passport.scatter import TAIL, Known, fit, interval, two_sided

FALSE_ALARM = 0.01
"""Probability that a session in which nothing changed raises any alarm."""
_LINES = 8  # degrees of freedom from which scatter is taken about lines, not about means
_CROOKED = 0.05
"""Probability of sessions as far from a line, below which it foretells nothing."""
_MANY = 1e6  # degrees of freedom, of which t is the normal distribution

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Scatter:
    """What sessions of a unit differ by although nothing changed.

    Attributes:
        variance: beyond the estimates' errors.
        freedom: degrees of freedom that it was estimated by; 0 if it could not be.
    """

    variance: float = 0.0
    freedom: int = 0

    def freedom_of(self, total: float, known: float) -> float:
        """Degrees of freedom of a variance of which a part is known.

        Fewer than those of F. E. Satterthwaite (1946), which go with the square of the share: so
        far out in the tails as alarms are, his are too many.
        """
        scattered = total - known
        return self.freedom * total / scattered if scattered > 1e-9 * total else _MANY


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
        return float(chi2.sf(self.left, self.spare)) >= _CROOKED

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
    table: Sessions, unit: str, begun: Mapping[str, Sequence[str]] | None = None
) -> Scatter:
    """Scatter between sessions of any unit, by all of them but the last one of this unit.

    It is taken about each unit's line, so that a slow change is not mistaken for it; about means
    where there are too few sessions for lines; and anew after each change that was told. What so
    few sessions may have hidden, one standard deviation of its estimate, is added: an alarm that is
    too many costs more than one that is late.

    Args:
        table: all units' sessions, in order.
        unit: whose last session is to be judged.
        begun: unit → sessions with which something new began.
    """
    last = max((key for key in table.keys if key[0] == unit), default=None)
    parts = []
    for name in table.units:
        own = table.where(np.array([k[0] == name and k != last for k in table.keys], bool))
        if own.keys:
            parts.append((own, _states(own, (begun or {}).get(name, ()))))
    lines = [(own, np.column_stack([means, _days(own) - _days(own)[0]])) for own, means in parts]
    variance, uncertain, freedom = _moments(lines)
    if freedom < _LINES:
        variance, uncertain, freedom = _moments(parts)
    return Scatter(variance + uncertain, freedom)


def change(mine: Sessions, usual: Scatter, last: int = 1) -> Change | None:
    """The last sessions of a unit against its earlier ones; None if there are no earlier ones.

    Args:
        mine: sessions of one unit, in order.
        usual: scatter between sessions.
        last: how many are the last: two show a change that one did not show for certain.
    """
    if len(mine.value) <= last:
        return None
    variance = mine.error**2 + usual.variance
    parts = slice(None, -last), slice(-last, None)
    means, known, total = np.zeros(2), np.zeros(2), np.zeros(2)
    left = 0.0
    for i, part in enumerate(parts):
        weight = 1.0 / variance[part]
        means[i], total[i] = (weight * mine.value[part]).sum() / weight.sum(), 1.0 / weight.sum()
        known[i] = 1.0 / (1.0 / mine.error[part] ** 2).sum()
        left += float((weight * (mine.value[part] - means[i]) ** 2).sum())
    freedom = usual.freedom_of(float(total.sum()), float(known.sum()))
    before, after = map(float, means)
    days = _days(mine)
    return Change(
        before=interval(before, float(total[0]), freedom),
        after=interval(after, float(known[1]), _MANY),
        days=float(days[-1] - days[-1 - last]),
        p=two_sided(abs(after - before) / np.sqrt(total.sum()), freedom),
        left=left,
        last=last,
    )


def trend(mine: Sessions, usual: Scatter) -> Trend | None:
    """The line through the sessions of a unit; None if there are fewer than three, or no time.

    Args:
        mine: sessions of one unit, in order.
        usual: scatter between sessions.
    """
    days = _days(mine)
    if len(days) < 3 or np.ptp(days) <= 0.0:
        return None
    design = np.stack([np.ones_like(days), days - days[-1]], axis=1)
    variance = mine.error**2 + usual.variance
    covariance = np.linalg.inv(design.T @ (design / variance[:, None]))
    value, slope = covariance @ design.T @ (mine.value / variance)
    freedom = usual.freedom_of(float(variance.mean()), float((mine.error**2).mean()))
    return Trend(
        slope=interval(float(slope), float(covariance[1, 1]), freedom),
        last_day=float(days[-1]),
        at_last=float(value),
        covariance=covariance,
        freedom=freedom,
        p=two_sided(abs(float(slope)) / np.sqrt(covariance[1, 1]), freedom),
        left=float(((mine.value - design @ [value, slope]) ** 2 / variance).sum()),
        spare=len(days) - 2,
    )


def alarms(chances: Mapping[K, float], rate: float = FALSE_ALARM) -> set[K]:
    """Which of the tests of one unit's session raise an alarm, by S. Holm's procedure.

    Args:
        chances: p-values by test.
        rate: probability of any alarm if nothing changed.
    """
    raised: set[K] = set()
    for i, key in enumerate(sorted(chances, key=lambda k: chances[k])):
        if chances[key] > rate / (len(chances) - i):
            break
        raised.add(key)
    return raised


def _days(table: Sessions) -> Float[np.ndarray, " session"]:
    return np.array([day(session) for _, session in table.keys])


def _states(own: Sessions, begun: Sequence[str]) -> Float[np.ndarray, "session state"]:
    """A column for each time between changes."""
    index = np.array([sum(first <= session for first in begun) for _, session in own.keys])
    return np.eye(int(index.max()) + 1)[index][:, np.unique(index)]


def _moments(
    parts: Sequence[tuple[Sessions, Float[np.ndarray, "_ _"]]],
) -> tuple[float, float, int]:
    """Variance of sessions about designs, each unit about its own, beyond their errors.

    Returns:
        (variance; standard deviation that its estimate has where there is none; degrees of
        freedom), all 0 where there are none.
    """
    q, trace, freedom = 0.0, 0.0, 0
    for own, design in parts:
        left = fit(own.value, np.diag(own.error**2), design)
        q, freedom = q + left.q, freedom + left.freedom
        trace += float(np.trace(left.projector)) if left.freedom else 0.0
    if not freedom or trace <= 0.0:
        return 0.0, 0.0, 0
    return max(0.0, (q - freedom) / trace), float(np.sqrt(2.0 * freedom)) / trace, freedom
