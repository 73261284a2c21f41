"""Time stamps: their unit, gaps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.check.velocity import related
from wt.types import Recording

UNITS = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_USUAL = (1.5e-4, 0.25)  # s, intervals of any controller's log
_GAP_S, _GAP_SAMPLES = 0.05, 10.0
"""A gap is longer than both: than what the smoothing of the motion bridges, and than hiccups."""
_LOST = 0.05  # of all samples, that may be missing one by one
_EVEN, _MOSTLY = 0.2, 0.9  # of a period, by which so many intervals may miss a whole number of them


@register
class Clock:
    """Time is in seconds, and no sample is missing."""

    kinds: ClassVar[tuple[str, ...]] = ("time_unit", "clock_gaps")
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
        yield from _gaps(recording)


def _gaps(recording: Recording) -> Iterable[AuditFinding]:
    """Samples that are missing: many in a row, or one here and there all along."""
    dt = np.diff(recording.t)
    usual = float(np.median(dt))
    absent = np.maximum(periods(recording.t) - 1.0, 0.0)
    gaps = np.flatnonzero(dt > max(_GAP_S, _GAP_SAMPLES * usual))
    share = float(absent.sum() / (len(dt) + absent.sum()))
    if len(gaps):
        longest = int(gaps[np.argmax(dt[gaps])])
        said = (
            f"{len(gaps)} gaps of up to {dt[longest]:.3g} s, the longest at "
            f"{recording.t[longest] - recording.t[0]:.4g} s; what happened there is unknown"
        )
    elif share > _LOST:
        said = (
            f"{100 * share:.0f} % of the samples are missing, up to {absent.max():.0f} in a row: "
            f"intervals are whole multiples of {1e3 * usual:.3g} ms"
        )
    else:
        return
    yield AuditFinding("clock_gaps", ("t",), (), said, "record again, or cut the recording there")


def periods(t: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " interval"]:
    """Periods in each interval, where most intervals are whole numbers of them; else 1."""
    ratio = np.diff(t) / float(np.median(np.diff(t)))
    whole = np.round(ratio)
    even = np.mean(np.abs(ratio - whole) < _EVEN) > _MOSTLY
    return np.asarray(whole if even else np.ones_like(ratio))


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
