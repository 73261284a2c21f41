"""Commands that the motion follows before they were sent.

No drive answers early. If the model explains the motion best with commands that come half a sample
earlier, they were not held from sample to sample: the controller ran faster than the log. If a
whole one, each command stands one row too late.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance
from wt.check.finding import AuditFinding
from wt.types import Recording

_SLOW_S, _SHORT_S = 0.015, 0.004
"""Intervals from which half a sample, and a whole one, can be told from other errors."""
_LEADS = np.arange(-0.5, 1.6, 0.1)  # samples
_DECISIVE = 1.5  # of the mean logarithm of what is left
_ALIKE = 0.5
_AGREED = 0.3  # … where most of several drives by themselves arrive at one sample
_ONE, _MOST = (0.75, 1.5), 0.7  # what counts as one; share of drives
_FARTHEST = 2.0  # samples, from which a lead is measured back
_MOST_BETWEEN = 10


@register
class CommandTiming:
    """A command is in force from its sample until the next."""

    kinds: ClassVar[tuple[str, ...]] = ("command_rate", "command_shifted")
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one, of all commands."""
        balance, recording = subject.balance, subject.recording
        if balance is None or recording is None or not balance.rows:
            return
        if balance.signals.dt < _SHORT_S or not balance.dynamic:
            return
        (lead, gain), agreed = _lead(balance), _agreed(balance)
        names = tuple(f"ctrl/{row.drive.name}" for row in balance.rows)
        elements = tuple(f"actuator {row.drive.name}" for row in balance.rows)
        dt = balance.signals.dt
        if gain >= _DECISIVE and 0.2 < lead < 0.75 and dt >= _SLOW_S and not agreed:
            yield AuditFinding(
                "command_rate",
                names,
                elements,
                f"The motion follows the commands up to half a sample before they were logged: the "
                f"controller ran faster than the log's {1 / dt:.0f} Hz",
                "log at the controller's rate; the commands between two samples are not known",
                0.9,
                change=lambda r: _between(r, names, _periods(balance)),
            )
        elif (gain >= _DECISIVE and 0.75 < lead < 1.35) or agreed:
            yield AuditFinding(
                "command_shifted",
                names,
                elements,
                f"The motion follows the commands {1e3 * dt:.3g} ms before they were "
                "logged, one sample: each stands one row too late",
                "write each command into the row of the sample it was sent at",
                0.95,
                change=lambda r: _earlier(r, names),
            )


def _left(balance: Balance, lead: float) -> Float[np.ndarray, " row"]:
    """What is left of each command if all come so many samples earlier, as a logarithm.

    Beside what a joint may lack: where a spring is missing, the command that holds against it looks
    like one that goes ahead of the motion.
    """
    s = balance.signals
    moved = replace(s, u=s.u + lead * s.dt * s.du)
    return np.asarray(np.log(balance.on(moved).unexplained(lenient=True) + 1e-7))


def _total(balance: Balance, lead: float) -> float:
    """The mean of it."""
    return float(_left(balance, lead).mean())


def _periods(balance: Balance) -> int:
    """The fewest periods of the controller in one of the log that explain the motion.

    A command that is held for 1/n of an interval takes effect (1 − 1/n)/2 of it earlier than one
    that is held throughout. That tells two periods from one, and hardly four from three: enough to
    fill commands in, and no measure of the controller's rate.
    """
    totals = {n: _total(balance, 0.5 * (1.0 - 1.0 / n)) for n in range(2, _MOST_BETWEEN + 1)}
    return next(n for n, total in totals.items() if total <= min(totals.values()) + _ALIKE)


def _lead(balance: Balance) -> tuple[float, float]:
    """The fewest samples that commands have to come earlier, and what moving them gains.

    Nothing, unless of at least two drives, or of the only one. A log has all commands early. A
    drive that feeds the velocity of its command forward answers as if its own came early, and the
    others, which do not move with it, as they should.
    """
    left = np.array([_left(balance, float(lead)) for lead in _LEADS])
    totals = left.mean(axis=1)
    # the balance allows for any delay, so more of a lead than there is does no harm
    enough = int(np.flatnonzero(totals <= totals.min() + _ALIKE)[0])
    gained = left[np.argmin(np.abs(_LEADS))] - left[enough]
    several = (gained > _ALIKE).sum() >= min(2, len(gained))
    return float(_LEADS[enough]), float(gained.mean()) if several else 0.0


def _agreed(balance: Balance) -> bool:
    """Tell whether most of several drives by themselves say that commands come one sample late.

    What a model lacks may look like a lead at one joint, and hardly like the same one at all.
    """
    s = balance.signals
    ahead = balance.on(replace(s, u=s.u + _FARTHEST * s.dt * s.du))
    leads = _FARTHEST - ahead.late() / s.dt
    one = (leads > _ONE[0]) & (leads < _ONE[1])
    if one.sum() < 2 or one.mean() < _MOST:
        return False
    return _total(balance, 0.0) - _total(balance, 1.0) > _AGREED


def _earlier(recording: Recording, names: tuple[str, ...]) -> Recording:
    columns = {
        n: np.append(c[1:], c[-1]) if n in names else c for n, c in recording.columns.items()
    }
    return replace(recording, columns=columns)


def _between(recording: Recording, names: tuple[str, ...], count: int) -> Recording:
    """The same with rows between, which have commands on the way and no measurement."""
    t = recording.t
    steps = np.arange(count) / count
    fine = np.append((t[:-1, None] + np.diff(t)[:, None] * steps).ravel(), t[-1])
    columns = {}
    for name, column in recording.columns.items():
        if name in names:
            columns[name] = _interpolated(fine, t, column)
        else:
            columns[name] = np.full(len(fine), np.nan)
            columns[name][::count] = column
    return replace(recording, t=fine, columns=columns)


def _interpolated(
    fine: Float[np.ndarray, " row"],
    t: Float[np.ndarray, " sample"],
    u: Float[np.ndarray, " sample"],
) -> Float[np.ndarray, " row"]:
    """Commands between samples: on a cubic spline if its like foretells samples better."""
    known = np.isfinite(u)
    t, u = t[known], u[known]
    a, b, c, d, e = (u[i : len(u) - 4 + i] for i in range(5))
    linear, cubic = c - (b + d) / 2.0, c - (4.0 * (b + d) - a - e) / 6.0
    if np.square(cubic).sum() < np.square(linear).sum():
        return np.asarray(CubicSpline(t, u)(fine))
    return np.interp(fine, t, u)
