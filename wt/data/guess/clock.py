"""Which quantity of a source is time, and in which unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt.data.guess.words import meaning
from wt.data.importers import _checks
from wt.data.importers._survey import Quantity, Survey
from wt.types import Recording

_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
PLACEHOLDER_HZ = 50.0
"""What stands in the map where nothing tells the rate."""
_SLOWEST, _FASTEST = 0.25, 1.5e-4  # s, intervals of any controller's log
_ALIKE = 0.9


@dataclass(frozen=True)
class Clock:
    """The believed time.

    Attributes:
        quantity: which it is, or None where the source has none.
        entry: of the map's ``time``.
        note: why it is believed.
        doubts: what would have to be known.
    """

    quantity: Quantity | None
    entry: dict[str, object]
    note: str
    doubts: tuple[str, ...] = ()


def clock(survey: Survey) -> Clock:
    """The time of a source.

    Args:
        survey: its rows.
    """
    rising = [q for q in survey.quantities if _rises(q)]
    named = [q for q in rising if meaning(q.name).kind == "time"]
    if not rising or (not named and survey.rate_hz):
        rate = survey.rate_hz or PLACEHOLDER_HZ
        said = "the file says so" if survey.rate_hz else "a mere placeholder"
        doubt = f"no row is a time: set 'time: {{rate: …}}' to the rate of the log ({said})"
        return Clock(None, {"rate": rate}, said, () if survey.rate_hz else (doubt,))
    chosen = (named or rising)[0]
    doubts = []
    if not named:
        doubts.append(f"no row is called time: {chosen.name!r} is the first that only increases")
    elif len(named) > 1:
        others = ", ".join(repr(q.name) for q in named[1:4])
        doubts.append(f"{chosen.name!r} is taken for time, and {others} would do as well")
    step = float(np.median(np.diff(chosen.values)))
    unit, unsure = _unit(meaning(chosen.name).seconds, step)
    doubts += [f"time: {line}" for line in unsure]
    scale = _UNITS[unit]
    entry = dict(chosen.entry) | ({} if scale == 1.0 else {"scale": scale})
    seconds = float(chosen.values[-1] - chosen.values[0]) * scale
    note = f"in {unit}: {1.0 / (step * scale):.4g} Hz for {seconds:.4g} s"
    return Clock(chosen, entry, note, tuple(doubts))


def rate_of(recording: Recording) -> float | None:
    """The rate at which speeds would be the slopes of their positions [Hz]; None if none is.

    Args:
        recording: at any even rate.
    """
    joints = [c.removeprefix("qpos/") for c in recording.columns if c.startswith("qpos/")]
    pairs = [_checks.velocity_over_slope(recording, joint) for joint in joints]
    factors = [factor for r, factor in pairs if r > _ALIKE]
    if not factors or max(factors) > 1.1 * min(factors):
        return None
    return float(f"{recording.rate_hz * float(np.median(factors)):.3g}")


def _rises(quantity: Quantity) -> bool:
    values = quantity.values
    return len(values) > 2 and bool(np.isfinite(values).all() and (np.diff(values) > 0).all())


def _unit(named: float | None, step: float) -> tuple[str, list[str]]:
    """The unit of a step, and what is unsure about it."""
    likely = [u for u, scale in _UNITS.items() if _FASTEST <= step * scale <= _SLOWEST]
    by_name = [u for u, scale in _UNITS.items() if scale == named]
    if by_name:
        doubt = f"its name says {by_name[0]}, with a sample every {step * _UNITS[by_name[0]]:.3g} s"
        return by_name[0], [] if by_name[0] in likely else [doubt]
    if not likely:
        return "s", [f"a step of {step:.4g} is in no usual unit; set 'scale' to seconds"]
    if len(likely) > 1:
        return likely[0], [f"a step of {step:.4g} may be in {' or '.join(likely)}; see 'scale'"]
    return likely[0], []
