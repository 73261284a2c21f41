"""Conditions and times under which a force residual shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter1d
from scipy.stats import ttest_ind

from wt.diagnose.evidence import Interval
from wt.diagnose.residual.screen import Screen
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.units import units_at
from wt.types import Location

MOST_INTERVALS = 10
_SMOOTH_S, _MERGE_S, _BLOCK_S, _SINCE_S = 0.1, 0.25, 1.0, 0.15
_BINS = 10


@dataclass(frozen=True)
class _Split:
    """Rows (R,) inside and outside a condition, rows of neither left out."""

    inside: Bool[np.ndarray, " row"]
    outside: Bool[np.ndarray, " row"]
    words: str


def intervals(
    screen: Screen, size: Float[np.ndarray, " row"], names: Sequence[str] = ()
) -> tuple[Interval, ...]:
    """Intervals in which a residual stands out.

    Args:
        screen: gives the rows' times.
        size: residual in units of its noise floor, (R,).
        names: of the recordings, by index; by default ``recording 1`` and so on.

    Returns:
        At most ``MOST_INTERVALS`` of each recording, in order of time.
    """
    m, rows = screen.motion, screen.rows
    level = max(
        THRESHOLDS.stands_out, THRESHOLDS.stands_out_share * float(np.quantile(np.abs(size), 0.95))
    )
    by_recording: dict[int, list[tuple[float, float]]] = {}
    for s in m.segments:
        mine = np.flatnonzero((rows >= s.rows.start) & (rows < s.rows.stop))
        if len(mine) < 2:
            continue
        by_recording.setdefault(s.recording, []).extend(
            standing_out(m.t[rows[mine]], size[mine], level)
        )
    return tuple(
        Interval(names[r] if r < len(names) else f"recording {r + 1}", start, end)
        for r in sorted(by_recording)
        for start, end in merged(by_recording[r])
    )


def standing_out(
    t: Float[np.ndarray, " time"], size: Float[np.ndarray, " time"], level: float
) -> list[tuple[float, float]]:
    """Intervals in which a size stands above a level, on average over a tenth of a second.

    Args:
        t: times without a gap, (T,) [s].
        size: what is compared, (T,).
        level: with what.
    """
    gap = float(np.median(np.diff(t)))
    width = max(1, round(_SMOOTH_S / gap))
    mean = np.sqrt(np.maximum(uniform_filter1d(size**2, width), 0.0))
    edges = np.diff(np.concatenate([[0], (mean > level).astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [
        (float(t[a] - gap / 2), float(t[b] + gap / 2)) for a, b in zip(starts, ends, strict=True)
    ]


def merged(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Close intervals joined, with growing tolerance until there are few."""
    near = _MERGE_S
    while True:
        joined: list[tuple[float, float]] = []
        for start, end in spans:
            if joined and start - joined[-1][1] <= near:
                joined[-1] = (joined[-1][0], end)
            else:
                joined.append((start, end))
        if len(joined) <= MOST_INTERVALS:
            return [(round(max(a, 0.0), 3), round(b, 3)) for a, b in joined]
        near *= 1.5


def condition(screen: Screen, size: Float[np.ndarray, " row"], dof: int, of: str = "") -> str:
    """The condition that tells best when a residual is large; "" if it always is.

    Speed, direction, position and load of a joint, time and command changes are compared
    by how much of the variance of the residual's logarithm they explain.

    Args:
        screen: the recordings.
        size: residual in units of its noise floor, (R,).
        dof: the joint whose motion counts.
        of: added where the joint is not the place itself, e.g. ``" of joint elbow"``.
    """
    m, rows = screen.motion, screen.rows
    segment = np.zeros(len(m), dtype=int)
    for i, s in enumerate(m.segments):
        segment[s.rows] = i
    label = np.stack([segment[rows], (m.t[rows] / _BLOCK_S).astype(int)], axis=1)
    _, block = np.unique(label, axis=0, return_inverse=True)
    energy = size**2
    splits = list(_splits(screen, dof, of))
    best, words = 0.0, ""
    for split in splits:
        score = _explained(np.log1p(energy), energy, split, block.ravel(), len(splits))
        if score > best:
            best, words = score, split.words
    return words


def _explained(
    log: Float[np.ndarray, " row"],
    energy: Float[np.ndarray, " row"],
    split: _Split,
    block: Int[np.ndarray, " row"],
    count: int,
) -> float:
    """Share of the logarithm's variance that a split explains; 0 if it is not clear enough."""
    a, b = split.inside, split.outside
    if min(a.sum(), b.sum()) < 8:
        return 0.0
    if energy[a].mean() < THRESHOLDS.condition_contrast * (energy[b].mean() + 1.0):
        return 0.0
    means = [_block_means(log[rows], block[rows]) for rows in (a, b)]
    if min(len(x) for x in means) < 3:
        return 0.0
    test = ttest_ind(means[0], means[1], equal_var=False, alternative="greater")
    if not test.pvalue * count < THRESHOLDS.condition_chance:
        return 0.0
    both = log[a | b]
    apart = a.sum() * b.sum() / len(both) ** 2 * (log[a].mean() - log[b].mean()) ** 2
    return float(apart / max(both.var(), 1e-12))


def _block_means(
    values: Float[np.ndarray, " row"], block: Int[np.ndarray, " row"]
) -> Float[np.ndarray, " block"]:
    count = np.bincount(block)
    return np.bincount(block, values)[count > 0] / count[count > 0]


def _splits(screen: Screen, dof: int, of: str) -> Iterator[_Split]:
    m, rows = screen.motion, screen.rows
    units = units_at(m.scene, Location("joint", m.scene.joints[dof]))
    length, load = units.position, units.force
    q, v, t = m.q[rows, dof], m.v[rows, dof], m.t[rows]
    # what the model demands, not what the drive gave: a drive answers the residual as well
    force = np.abs(m.demand[rows, dof])
    speed, quantiles = np.abs(v), np.linspace(0.0, 1.0, _BINS + 1)[1:-1]
    for x in np.unique(np.quantile(speed, quantiles)):
        yield _Split(speed < x, speed >= x, f"at speeds below {_two(x)} {length}/s{of}")
        # below that, everything that needs motion vanishes: no condition worth a word
        if x > 2.0 * THRESHOLDS.slow:
            yield _Split(speed > x, speed <= x, f"at speeds above {_two(x)} {length}/s{of}")
    for sign, word in ((1, "positive"), (-1, "negative")):
        along = sign * v > THRESHOLDS.slow
        yield _Split(along, sign * v < -THRESHOLDS.slow, f"when moving in the {word} direction{of}")
    yield from _positions(q, quantiles, length, of)
    for x in np.unique(np.quantile(force, quantiles)):
        if force.max() > 0.0:
            yield _Split(force > x, force <= x, f"at loads above {_two(x)} {load}{of}")
            yield _Split(force < x, force >= x, f"at loads below {_two(x)} {load}{of}")
    late = t > 0.5 * t.max()
    yield _Split(late, ~late, "growing with time")
    yield _Split(~late, late, "fading with time")
    changed = _just_changed(screen, dof)
    if 0.02 < changed.mean() < 0.7:
        yield _Split(changed, ~changed, f"after commands change{of}")


def _positions(
    q: Float[np.ndarray, " row"], quantiles: Float[np.ndarray, " quantile"], unit: str, of: str
) -> Iterator[_Split]:
    for x in np.unique(np.quantile(q, quantiles)):
        yield _Split(q > x, q <= x, f"at positions above {_two(x)} {unit}{of}")
        yield _Split(q < x, q >= x, f"at positions below {_two(x)} {unit}{of}")
    low, high = np.quantile(q, [0.005, 0.995])
    edges = np.linspace(low, high, 2 * _BINS + 1)
    for wide in range(1, 7):
        for i in range(len(edges) - wide):
            inside = (q >= edges[i]) & (q <= edges[i + wide])
            middle = 0.5 * (edges[i] + edges[i + wide])
            yield _Split(inside, ~inside, f"near {_two(middle)} {unit}{of}")


def _just_changed(screen: Screen, dof: int) -> Bool[np.ndarray, " row"]:
    """Rows shortly after a command of the joint's drives changed."""
    m = screen.motion
    recent = np.zeros(len(m), bool)
    for drive in m.scene.drives:
        if drive.dof != dof:
            continue
        for s in m.segments:
            u = m.command[s.rows, drive.index]
            step = np.abs(np.diff(u, prepend=u[0])) > 1e-6 * (np.ptp(u) + 1e-12)
            last = np.maximum.accumulate(np.where(step, np.arange(len(u)), -(10**9)))
            recent[s.rows] |= np.arange(len(u)) - last <= _SINCE_S / s.dt
    return recent[screen.rows]


def _two(value: float) -> str:
    """Two significant digits."""
    return f"{float(f'{value:.1e}'):g}"
