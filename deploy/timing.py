"""Regularity of the control loop, and duration of inference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np


@dataclass(frozen=True)
class DurationSummary:
    """A distribution of times.

    Attributes:
        p50: median [ms].
        p99: of a hundred, one is longer [ms].
        max: the longest [ms].
        count: how many there were.
    """

    p50: float
    p99: float
    max: float
    count: int

    @classmethod
    def of(cls, seconds: Sequence[float] | np.ndarray) -> DurationSummary:
        """From times in seconds; all zero if there are none."""
        ms = 1e3 * np.asarray(seconds, float)
        if not len(ms):
            return cls(0.0, 0.0, 0.0, 0)
        p50, p99 = np.percentile(ms, [50, 99])
        return cls(float(p50), float(p99), float(ms.max()), len(ms))


@dataclass(frozen=True)
class Timing:
    """The timing report of a run.

    Attributes:
        period: from one tick of the control loop to the next.
        jitter: by how much that differs from what it is to be, either way.
        inference: of the policy.
        age: of the robot's state when it was acted on.
    """

    period: DurationSummary
    jitter: DurationSummary
    inference: DurationSummary
    age: DurationSummary

    @classmethod
    def of(
        cls, ticks: np.ndarray, period: float, inference: Sequence[float], ages: np.ndarray
    ) -> Timing:
        """From when ticks began [s], what their period is to be [s], and the other times [s]."""
        periods = np.diff(ticks)
        return cls(
            DurationSummary.of(periods),
            DurationSummary.of(np.abs(periods - period)),
            DurationSummary.of(inference),
            DurationSummary.of(ages),
        )

    def text(self) -> str:
        """As a table."""
        lines = [f"{'[ms]':<16}{'p50':>9}{'p99':>9}{'max':>9}{'count':>9}"]
        for name, row in (
            ("loop period", self.period), ("loop jitter", self.jitter),
            ("inference", self.inference), ("age of state", self.age),
        ):  # fmt: skip
            lines.append(f"{name:<16}{row.p50:>9.3f}{row.p99:>9.3f}{row.max:>9.3f}{row.count:>9}")
        return "\n".join(lines)

    def dict(self) -> dict[str, dict[str, float]]:
        """As plain numbers [ms]."""
        return asdict(self)
