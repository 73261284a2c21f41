"""Pieces of recordings that are replayed open loop: long where a machine forgets how it began."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from wt.diagnose.recordings.samples import Samples
from wt.diagnose.recordings.smooth import Smoothed
from wt.physics.planted import Hypothesis
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

SampleRange = tuple[int, int, int]
"""A segment, its first sample, and the one after its last."""

WINDOW_S, FLOATING_S = 0.5, 0.25
"""Length of the stretches of a machine that does not forget its initial state [s], and of one on
legs: what feet do to each other's forces soon makes two replays of the same walk two walks."""
WINDOWS_S = (WINDOW_S, 1.0, 2.0, 4.0)
"""What windows may be as long as: the longer, the better a replay tells one law from another, as
long as it does not lose the recording."""
_LONG_S, BLOCK_S = 10.0, 4.0
"""Most that stretches of a machine that forgets are long [s], and where many hypotheses are
compared: laws are stepped for all stretches at once, so that short ones cost little more than one.
Not shorter: friction at standstill begins unbent in each."""
BURN_IN_S = 0.25
"""Start of a long stretch that is not scored: hidden states (gears, buffers) settle [s]."""
LEAD_S = 0.3
"""Commands of so long before a stretch [s] reach drives that are late, or slow, in it."""
_TEST_S, _SHOVE, _FORGOTTEN = 1.5, 0.02, 0.3
_TRIED, _GROWTH, _LOST = 6, 3.0, 0.3
"""Windows that are tried of each length, how fast shoves may grow in them [1/s], and what share of
the spread of its positions a joint may err by, before its replay counts as lost."""
_LOOSE, _LOOSEST = 4.0, 3.0
"""Knots at a segment's ends where the slope of a curve is not to be trusted over a long stretch,
nor in a window, whose begin may adapt."""
_JUMP, _LEAST = 10.0, 0.05
"""A command jumps by so many times its usual change, and such a share of its range."""
_AROUND, _MISFIT = 9, 2.0
"""Samples around a start, and how much noise the curve may miss the measured positions by there."""


def forgets(smoothed: Smoothed, step: float) -> bool:
    """Tell whether the model forgets its initial state: a position servo does, a pendulum not.

    Replays from two initial states, ``_SHOVE`` rad apart in every joint, must come to within
    ``_FORGOTTEN`` of that. Nothing brings a floating base back to where it was.
    """
    if smoothed.motion.scene.free:
        return False
    t = smoothed.samples[0].t
    first = cut(smoothed, 0, slice(0, int(np.searchsorted(t, t[0] + _TEST_S, side="right"))))
    pair = [replace(first, q0=first.q0 + shove) for shove in (0.0, _SHOVE)]
    q = Replayer(smoothed.motion.scene, pair, step).run([()]).q[0]
    one, other = np.split(q, 2)
    apart = np.abs(other[-1] - one[-1])
    return bool(np.isfinite(apart).all() and (apart < _FORGOTTEN * _SHOVE).all())


def longest_window(smoothed: Smoothed, step: float, hypothesis: Hypothesis = ()) -> float:
    """Length of the longest windows [s] whose replays tell of laws, and not of how they began.

    For a machine that does not forget, and does not float: shoves may grow with time, as the phase
    of a swing does, but no faster, as they do where motion is chaotic; and what the hypothesis
    still lacks must not carry its replays away from the recordings.
    """
    spread = np.nanmax([np.nanstd(s.q, axis=0) for s in smoothed.samples], axis=0)
    longest = WINDOWS_S[0]
    for length in WINDOWS_S[1:]:
        pairs = stretches_of(smoothed, False, _TRIED * length, window=length)
        if max(s.t[-1] - s.t[0] for s, _ in pairs) < 0.75 * length:
            break
        shoved = [replace(s, q0=s.q0 + _SHOVE) for s, _ in pairs]
        both = Replayer(smoothed.motion.scene, [s for s, _ in pairs] + shoved, step)
        q, other = np.split(both.run([hypothesis]).q[0], 2)
        error = np.sqrt(np.nanmean((q - np.concatenate([x for _, x in pairs])) ** 2, axis=0))
        grown, lost = np.abs(other - q).max() / _SHOVE, (error > _LOST * spread).any()
        if not grown <= _GROWTH * length or lost or not np.isfinite(q).all():
            break
        longest = length
    return longest


def cut(smoothed: Smoothed, index: int, rows: slice) -> Stretch:
    """Some samples of a segment, to be replayed from the smooth state at the first of them."""
    s, (q, v, _) = smoothed.samples[index], smoothed.at_samples[index]
    first, segment = rows.start, smoothed.motion.segments[index]
    lead = slice(int(np.searchsorted(s.t, s.t[first] - LEAD_S)), first)
    known = (q[first], v[first], s.activation[first], s.t[lead], s.command[lead])
    return Stretch(s.recording, s.t[rows], s.command[rows], *known, segment, smoothed.motion)


def stretches_of(
    smoothed: Smoothed,
    forgets: bool,
    seconds: float = np.inf,
    telling: float = 0.0,
    window: float | None = None,
) -> list[tuple[Stretch, Float[np.ndarray, "_ dof"]]]:
    """Cut recordings into stretches to replay, with the positions measured in them.

    Args:
        smoothed: the recordings.
        forgets: long stretches if so, else windows.
        seconds: at most this much in all; blocks spread evenly over the recordings.
        telling: share of them that is not, where windows are chosen from more than that: these are
            where forces differ most from the usual. A stop is hit, and a foot slips, now and then.
        window: length of windows [s]; if left out, the shortest, and blocks of a machine that
            forgets are as long as its recordings.
    """
    total = sum(float(s.t[-1] - s.t[0]) for s in smoothed.samples)
    keep = min(1.0, seconds / total)
    telling = 0.0 if forgets or keep == 1.0 else telling
    if window is None and not forgets:
        window = FLOATING_S if smoothed.motion.scene.free else WINDOW_S
    blocks = [
        (i, *block)
        for i, s in enumerate(smoothed.samples)
        for block in _blocks(s, keep * (1.0 - telling), forgets, window)
    ]
    if telling and window:
        blocks = sorted(blocks + _telling(smoothed, blocks, round(telling * keep * total / window)))
    ready, pieces = [_ready(smoothed, i, forgets) for i in range(len(smoothed.samples))], []
    measured = [s.measured for s in smoothed.samples]
    if forgets:
        blocks = _overlapping(smoothed, blocks, ready)
    for i, first, last in blocks:
        later = ready[i][(ready[i] >= first) & (ready[i] <= (first + last) // 2)]
        rows = slice(int(later[0]) if len(later) else first, last)
        piece = cut(smoothed, i, rows)
        if not forgets:
            piece = replace(piece, unsure=smoothed.unsure[i])
        pieces.append((piece, measured[i][rows]))
    return pieces


def _overlapping(
    smoothed: Smoothed, blocks: list[SampleRange], ready: list[Int[np.ndarray, " _"]]
) -> list[SampleRange]:
    """The same, but what follows another begins inside of it, where the motion is known.

    So early that it has settled where the other ends: each sample is scored once.
    """
    overlapping: list[SampleRange] = []
    for i, first, last in blocks:
        j, start, end = overlapping[-1] if overlapping else (-1, 0, 0)
        t = smoothed.samples[i].t
        if i == j and t[first] - t[end - 1] < BURN_IN_S:
            settled = np.searchsorted(t, t[end - 1] - BURN_IN_S, side="right") - 1
            inside = ready[i][(ready[i] >= (start + end) // 2) & (ready[i] <= settled)]
            if len(inside):
                first = int(inside[-1])
                scored = int(np.searchsorted(t, t[first] + BURN_IN_S))
                overlapping[-1] = (i, start, scored)
        overlapping.append((i, first, last))
    return overlapping


def _telling(smoothed: Smoothed, taken: list[SampleRange], count: int) -> list[SampleRange]:
    """``count`` more windows, as long as those taken: where the unexplained is most unusual."""
    if not count:
        return []
    m, scored = smoothed.motion, []
    usual = 1.4826 * np.median(np.abs(m.unexplained), axis=0) + 1e-12
    unusual = (m.unexplained / usual) ** 2 * m.calm[:, None]
    for i, (s, segment) in enumerate(zip(smoothed.samples, m.segments, strict=True)):
        mine = [(first, last) for j, first, last in taken if j == i]
        size = mine[0][1] - mine[0][0]
        for first in range(0, len(s.t) - size + 1, size):
            if all(first + size <= f or first >= last for f, last in mine):
                ends = np.searchsorted(m.t[segment.rows], s.t[[first, first + size - 1]])
                here = unusual[segment.rows][ends[0] : ends[1] + 1]
                scored.append((float(here.mean(axis=0).max()), (i, first, first + size)))
    scored.sort(reverse=True)
    return [block for _, block in scored[:count]]


def _ready(smoothed: Smoothed, index: int, forgets: bool) -> Int[np.ndarray, " start"]:
    """Samples of a segment that a stretch may begin with."""
    s, (q, _, _) = smoothed.samples[index], smoothed.at_samples[index]
    n = smoothed.commands
    knot = max(smoothed.spacing[index]) * n
    known = _known(s.q - q, smoothed.noise) & ~_jolted(s.command, knot)
    for fast in np.concatenate([c.fast for c in smoothed.curves[index]]):
        known &= (s.t < fast[0]) | (s.t > fast[1])  # there it follows noise
    ready = np.flatnonzero(known)
    return ready[ready >= (_LOOSE if forgets else _LOOSEST) * knot]


def _jolted(
    command: Float[np.ndarray, "sample actuator"], knot: float
) -> Bool[np.ndarray, " sample"]:
    """Samples within a knot of a jump of a command: the curve's velocity turns too early there."""
    change = np.abs(np.diff(command, axis=0, prepend=command[:1]))
    usual = _JUMP * np.median(change, axis=0) + _LEAST * np.ptp(command, axis=0)
    jump = (change > usual).any(axis=1)
    return np.asarray(maximum_filter1d(jump, 2 * int(np.ceil(knot)) + 1, mode="constant"))


def _known(
    misfit: Float[np.ndarray, "sample dof"], noise: Float[np.ndarray, " dof"]
) -> Bool[np.ndarray, " sample"]:
    """Samples at which the smooth curve is to be trusted as an initial state.

    Not where it misses the samples, as in a jolt that is faster than its knots.
    """
    square = np.nan_to_num(misfit / noise) ** 2
    local = uniform_filter1d(square, _AROUND, axis=0, mode="nearest")
    return np.asarray((local < _MISFIT**2).all(axis=1))


def _blocks(s: Samples, keep: float, forgets: bool, window: float | None) -> list[tuple[int, int]]:
    """Ranges of samples: windows [s], or blocks that are no longer; the given share is kept."""
    length = s.t[-1] - s.t[0]
    if window is None:
        if keep >= 0.999:
            return [(0, len(s.t))]
        window = _LONG_S
    count = keep * length / window
    count = max(1, int(np.ceil(count) if forgets else count))
    size = max(12, int(keep * len(s.t) / count))
    starts = np.linspace(0, len(s.t) - size, count).astype(int)
    return [(int(i), int(i + size)) for i in np.unique(starts)]
