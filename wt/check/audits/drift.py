"""Commands stamped by a clock that runs faster, or slower, than that of the measurements.

A delay is the same from the first sample to the last, and physics; one that grows is a clock's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance
from wt.check.finding import AuditFinding
from wt.check.signals import Signals
from wt.types import Recording

_SHOWN = 0.1  # of the forces, that a drift of any size leaves unexplained
_SHIFTS_S = np.geomspace(0.04, 0.5, 10)  # that a drift makes over the whole recording
_SPREADS = (0.3, 0.06)  # of a drift, within which it is sought more finely
_LEAD_S = -0.04  # of all commands: the balance makes up for a delay, and for no lead
_DELAYS_S = np.arange(-0.4, 0.41, 0.08)
_PROMISING = 1.0  # of the same, by which a drift that is nearly right may fall short of a delay
_DECISIVE = math.log(5.0)  # of the mean logarithm of what is left


@register
class ClockDrift:
    """Commands and measurements keep the same time."""

    kinds: ClassVar[tuple[str, ...]] = ("clock_drift",)
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one, of all commands."""
        balance, recording = subject.balance, subject.recording
        if balance is None or recording is None or not balance.dynamic or not balance.rows:
            return
        if balance.unexplained_forces().max() < _SHOWN:
            return
        late = min(_left(balance, recording, _Retimed(0.0, float(d))) for d in _DELAYS_S)
        rate, left = _best(balance, recording, late)
        if left > late - _DECISIVE:
            return
        names = tuple(n for n in recording.columns if n.startswith("ctrl/"))
        yield AuditFinding(
            "clock_drift",
            names,
            (),
            f"The motion follows the commands ever {'earlier' if rate > 0 else 'later'}, by "
            f"{1e3 * abs(rate):.3g} ms more each second: their stamps are another clock's",
            "stamp commands and measurements by one clock",
            0.9,
            change=_Retimed(rate, 0.0),
        )


def _best(balance: Balance, recording: Recording, late: float) -> tuple[float, float]:
    """The drift that explains most, and the mean logarithm of what is left with it.

    It is sought more finely only where it may come to explain more than a delay, which leaves
    ``late``.
    """
    score: dict[float, float] = {}
    rates = np.concatenate([-_SHIFTS_S, _SHIFTS_S]) / recording.seconds
    for spread in (*_SPREADS, 0.0):
        score |= {float(r): _left(balance, recording, _Retimed(float(r), _LEAD_S)) for r in rates}
        best = min(score, key=lambda r: score[r])
        if score[best] > late + _PROMISING:
            break
        rates = best * np.linspace(1.0 - spread, 1.0 + spread, 7)
    return best, score[best]


@dataclass(frozen=True)
class _Retimed:
    """Commands stamped anew: each was in force so much later.

    Attributes:
        rate: of the delay, per time since the start.
        delay: at the start [s].
    """

    rate: float
    delay: float

    def __call__(self, recording: Recording) -> Recording:
        since = recording.t - recording.t[0]
        stamps = (1.0 + self.rate) * since + self.delay
        columns = {
            name: np.interp(since, stamps, column) if name.startswith("ctrl/") else column
            for name, column in recording.columns.items()
        }
        return replace(recording, columns=columns)


def _left(balance: Balance, recording: Recording, retimed: _Retimed) -> float:
    signals = Signals.of(balance.scene, retimed(recording))
    assert signals is not None
    return balance.on(signals).misfit()
