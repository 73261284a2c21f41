"""Choice of the columns that an unexplained force depends on: of the moment, of the past, or time.

Candidate sets of columns are compared by how well a regression on them predicts blocks of time it
has not seen; the smallest set within one standard error of the best is chosen (L. Breiman et al.,
Classification and Regression Trees, 1984). First come smooth functions of what was recorded at one
moment. Where those leave something, forces are tried that remember
(:mod:`wt.diagnose.unknown.memory`), and one that beats at a pace of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.signal import lombscargle

from wt.diagnose.unknown.fit import ForceData, LawFit, crossval, smooth_terms
from wt.diagnose.unknown.law import Atom, Term
from wt.diagnose.unknown.memory import Kind, Memory, memory_of

MOST_COLUMNS = 4
_LEADING = 4  # columns that are tried in pairs with all others
_LITTLE = 0.4  # predicted share below which a drive's columns are considered, and must add
_ENOUGH = 0.97  # predicted share beyond which nothing is added
_CREEPS_S = (0.04, 0.1, 0.25, 0.6, 1.5, 4.0)
_SWINGS = tuple(2.0 * 1.1**k for k in range(40))  # rad/s: to 80, as close as resonances are narrow
_DAMPING = (0.03, 0.1, 0.3)
_POLISHED = 4  # rounds in which a rate is moved to where it fits best
_BEATS = 4.0  # periods that a recording must hold, or it is a drift
_BANDWIDTH = 0.7  # of the rows' own, up to which a pace can be told
_AT_ONCE = 2_000_000  # rows times paces that are compared at once, to bound memory


def choose(data: ForceData) -> tuple[LawFit, int]:
    """The columns that the force depends on, and the number of sets that were tried.

    A drive that holds a position answers an unknown force with one of its own, so that command
    and drive force predict it without being its cause: they count only where the state, which
    moves freely, predicts little.
    """
    fit, tried = freest(data)
    if fit.r2 >= _LITTLE or not data.drive():
        return fit, tried
    with_drive, more = choose_among(data, [*data.state(), *data.drive()])
    return (with_drive if with_drive.r2 > fit.r2 + _LITTLE else fit), tried + more


def freest(data: ForceData) -> tuple[LawFit, int]:
    """The best of what positions, velocities and time, now and before, say of the force."""
    fit, tried = choose_among(data, data.state())
    if fit.r2 >= _ENOUGH:
        return fit, tried
    others = [best for best in (_creep(data), _swing(data), _beat(data)) if best is not None]
    for other, count in others:
        tried += count
        if _clearly(other, fit):
            fit = other
    return fit, tried


def choose_among(data: ForceData, names: Sequence[str]) -> tuple[LawFit, int]:
    """The smallest set of columns within one standard error of the best, and the number tried.

    Args:
        data: the force.
        names: columns to choose from.
    """

    def fitted(columns: Sequence[str]) -> LawFit:
        return crossval(data, columns, smooth_terms(data, columns))

    singles = sorted((fitted([n]) for n in names), key=_total)
    leading = [f.names[0] for f in singles[:_LEADING]]
    tried = [*singles, *(fitted(pair) for pair in _pairs(names, leading))]
    best = min(tried, key=_total)
    while len(best.names) in range(2, MOST_COLUMNS) and best.r2 < _ENOUGH:
        larger = [fitted([*best.names, n]) for n in names if n not in best.names]
        tried += larger
        grown = min([best, *larger], key=_total)
        if grown is best or not _clearly(grown, best):
            break
        best = grown
    return _smallest(tried, best), len(tried)


def _pairs(names: Sequence[str], leading: Sequence[str]) -> list[tuple[str, ...]]:
    """The leading columns and the joint's own, the first two, each with every other one."""
    own = names[:2]
    pairs = {tuple(sorted((a, b), key=names.index)) for a in {*leading, *own} for b in names}
    return [pair for pair in sorted(pairs) if pair[0] != pair[1]]


def _smallest(tried: Sequence[LawFit], best: LawFit) -> LawFit:
    """The best of the fewest columns among what is not clearly worse than the best of all."""
    good = [fit for fit in tried if not _clearly(best, fit)]
    fewest = min(len(fit.names) for fit in good)
    return min((fit for fit in good if len(fit.names) == fewest), key=_total)


def remembers(fit: LawFit) -> bool:
    """Tell whether a regression is a formula already: of a hidden state, or of a pace."""
    paced = any(a.kind == "sin" for term in fit.terms for a in term)
    return paced or any(memory_of(name) for name in fit.names)


def _creep(data: ForceData) -> tuple[LawFit, int]:
    """A spring that yields, over time constants."""

    def fitted(rate: float) -> LawFit:
        return _linear(data, [_named("creep", data.joint, rate)])

    fit, tried = _polished(fitted, [(tau,) for tau in _CREEPS_S], [_CREEPS_S[1] / _CREEPS_S[0]])
    return _leaner(data, fit), tried


def _swing(data: ForceData) -> tuple[LawFit, int]:
    """A mass on a spring that is dragged along, over frequencies and damping ratios."""

    def fitted(rate: float, damping: float) -> LawFit:
        kinds: tuple[Kind, ...] = ("swing", "swing_rate")
        return _linear(data, [_named(k, data.joint, rate, damping) for k in kinds])

    grid = [(rate, damping) for rate in _SWINGS for damping in _DAMPING]
    gaps = [_SWINGS[1] / _SWINGS[0], _DAMPING[1] / _DAMPING[0]]
    fit, tried = _polished(fitted, grid, gaps)
    return _leaner(data, fit), tried


def _beat(data: ForceData) -> tuple[LawFit, int] | None:
    """A force that turns at a pace of its own, whatever the machine does."""
    motion = data.screen.motion
    t = motion.t[data.screen.rows[data.rows]]
    gaps = np.diff(t)  # not of all times together: those of two recordings nearly coincide
    spacing = float(np.median(gaps[gaps > 0.0]))
    slowest, fastest = 2.0 * np.pi * _BEATS / np.ptp(t), _BANDWIDTH * np.pi / spacing
    if fastest <= slowest:
        return None
    grid = np.arange(slowest, fastest, 1.0 / np.ptp(t))
    parts = np.array_split(grid, -(-len(grid) * len(t) // _AT_ONCE))
    power = np.concatenate([lombscargle(t, data.force, part) for part in parts])
    pace = float(grid[np.argmax(power)])

    def fitted(rate: float) -> LawFit:
        terms: list[Term] = [(Atom(0, "sin", 0.0, rate),), (Atom(0, "cos", 0.0, rate),)]
        return crossval(data, ["t"], terms, penalise=False)

    near = 1.0 + 1.0 / (pace * float(np.ptp(t)))
    fit, tried = _polished(fitted, [(pace,)], [near**2])
    return fit, tried + len(grid)


def _named(kind: Kind, joint: str, rate: float, damping: float = 0.0) -> str:
    return Memory(kind, joint, rate, damping).name


def _linear(data: ForceData, names: Sequence[str]) -> LawFit:
    """Columns that remember, beside the joint's position and speed, each with one factor."""
    own = [n for n in data.state()[:2] if n != "t"]
    every = [*names, *own]
    return crossval(data, every, [(Atom(i, "linear"),) for i in range(len(every))], penalise=False)


def _leaner(data: ForceData, fit: LawFit) -> LawFit:
    """The regression without what does not clearly add to its hidden state."""
    names = list(fit.names)
    for name in [n for n in fit.names if memory_of(n) is None]:
        fewer = [n for n in names if n != name]
        terms = [(Atom(i, "linear"),) for i in range(len(fewer))]
        without = crossval(data, fewer, terms, penalise=False)
        if not _clearly(fit, without):
            fit, names = without, fewer
    return fit


def _polished(
    fitted: Callable[..., LawFit], grid: Sequence[tuple[float, ...]], gaps: Sequence[float]
) -> tuple[LawFit, int]:
    """The best regression over some rates, and the number of those tried.

    Args:
        fitted: the regression at given rates.
        grid: rates to try first.
        gaps: factor between neighbours along each rate; ever smaller roots of it are tried then.
    """
    tried = {at: fitted(*at) for at in grid}
    for k in range(1, _POLISHED + 1):
        for i, gap in enumerate(gaps):
            best, step = min(tried, key=lambda at: _total(tried[at])), gap**0.5**k
            for rate in (best[i] / step, best[i] * step):
                at = (*best[:i], rate, *best[i + 1 :])
                tried[at] = fitted(*at)
    return min(tried.values(), key=_total), len(tried)


def _total(fit: LawFit) -> float:
    return float(fit.error.sum())


def _clearly(better: LawFit, worse: LawFit) -> bool:
    """Tell whether the difference is more than a standard error, over blocks."""
    difference = worse.error - better.error
    return bool(difference.sum() > np.sqrt(len(difference)) * difference.std(ddof=1) + 1e-30)
