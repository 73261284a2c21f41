"""Time stamps: their unit, gaps, jitter."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.check.velocity import related
from wt.types import Recording

UNITS = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_USUAL = (1.5e-4, 0.25)  # s, intervals of any controller's log
_GAP_S, _GAP_SAMPLES = 0.15, 10.0
_UNEVEN = 0.8  # of an interval: spread of the middle nine tenths of all intervals


@register
class Clock:
    """Time is in seconds, and runs evenly."""

    kinds: ClassVar[tuple[str, ...]] = ("time_unit", "clock_gaps", "clock_jitter")
    stage: ClassVar[Stage] = "clock"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one of each kind."""
        recording = subject.recording
        if recording is None:
            return
        wrong_unit = _unit(recording)
        if wrong_unit:
            yield wrong_unit
            assert wrong_unit.change is not None
            recording = wrong_unit.change(recording)
        dt = np.diff(recording.t)
        usual = float(np.median(dt))
        gaps = np.flatnonzero(dt > max(_GAP_S, _GAP_SAMPLES * usual))
        if len(gaps):
            longest = int(gaps[np.argmax(dt[gaps])])
            yield AuditFinding(
                "clock_gaps",
                ("t",),
                (),
                f"{len(gaps)} gaps of up to {dt[longest]:.3g} s, the longest at "
                f"{recording.t[longest] - recording.t[0]:.4g} s; what happened there is unknown",
                "record again, or cut the recording there",
            )
        low, high = np.quantile(dt, [0.05, 0.95]) / usual
        if high - low > _UNEVEN:
            yield AuditFinding(
                "clock_jitter",
                ("t",),
                (),
                f"Nine tenths of the intervals are {1e3 * low * usual:.3g} to "
                f"{1e3 * high * usual:.3g} ms long, where the usual one is {1e3 * usual:.3g} ms",
                "stamp samples where they are taken, not where they are written",
            )


def _unit(recording: Recording) -> AuditFinding | None:
    """Time in another unit than seconds: no controller is so slow."""
    dt = float(np.median(np.diff(recording.t)))
    if dt <= _USUAL[1]:
        return None
    factors = {n: f for n, f in UNITS.items() if _USUAL[0] <= dt * f <= _USUAL[1]}
    if not factors:
        return None
    name, factor = next(iter(factors.items()))
    mended = replace(recording, t=recording.t * factor) if _long_enough(recording, factor) else None
    if mended is None:
        return None
    said = f"'t' has a sample every {dt:.4g}; in {name} that is {1.0 / (dt * factor):.4g} Hz"
    agree = [
        c.removeprefix("qvel/")
        for c in recording.columns
        if c.startswith("qvel/")
        and (r := related(mended, c.removeprefix("qvel/"), c.removeprefix("qvel/")))
        and 0.8 < r.factor < 1.25
    ]
    if agree:
        said += f", and the velocity of {agree[0]} then is the slope of its position"
    return AuditFinding(
        "time_unit",
        ("t",),
        (),
        said,
        f"time: {{column: t, scale: {factor:g}}}, or multiply 't' by {factor:g}",
        change=lambda r: replace(r, t=r.t * factor),
    )


def _long_enough(recording: Recording, factor: float) -> bool:
    return recording.seconds * factor >= Recording.MIN_SECONDS
