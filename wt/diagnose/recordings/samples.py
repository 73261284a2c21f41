"""The measured samples of recordings: parts, segments without gaps, and their true time stamps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import Akima1DInterpolator
from scipy.optimize import isotonic_regression

from wt.errors import RecordingError
from wt.physics import base
from wt.physics.activation import activated
from wt.physics.scene import Scene
from wt.types import Recording

LONG_GAP = 0.15
"""A gap longer than this [s] ends a segment: what happened in it is not known."""
SHORTEST = 0.5
"""Segments shorter than this [s] are left out."""
ESTIMATED = "estimated"
"""Key of a prepared recording's metadata: names of the free joints whose motion was computed."""
_TINY = 1e-6
"""Least share of a mean square that counts as half of a column's: at rest, nothing is off."""
_PARTS = 8  # whole intervals by which their number is searched either way


@dataclass(frozen=True, eq=False)
class Part:
    """A recording, or a part of one.

    Attributes:
        recording: the whole recording.
        index: its position among the recordings.
        span: from when to when it is this part, since the recording's start [s].
    """

    recording: Recording
    index: int
    span: tuple[float, float] = (0.0, np.inf)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return min(self.span[1], self.recording.seconds) - self.span[0]


@dataclass(frozen=True, eq=False)
class Samples:
    """The measured samples of one segment.

    Attributes:
        recording: which recording it belongs to.
        t: time since the recording's start [s].
        q: measured positions [rad or m]; NaN where missing.
        v: measured velocities; NaN where missing or not recorded.
        command: commands.
        activation: what each drive acts on: what its own dynamics make of its commands.
        estimated: degrees of freedom whose motion was not measured but computed from an IMU.
    """

    recording: int
    t: Float[np.ndarray, " sample"]
    q: Float[np.ndarray, "sample dof"]
    v: Float[np.ndarray, "sample dof"]
    command: Float[np.ndarray, "sample actuator"]
    activation: Float[np.ndarray, "sample actuator"]
    estimated: tuple[int, ...] = ()

    @property
    def measured(self) -> Float[np.ndarray, "sample dof"]:
        """Positions that replays are compared with: NaN too where an estimator says them."""
        q = self.q.copy()
        q[:, self.estimated] = np.nan
        return q

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.t)))


def samples_of(
    scene: Scene,
    parts: Sequence[Part],
    begun: Mapping[int, Float[np.ndarray, " actuator"]] | None = None,
) -> tuple[Samples, ...]:
    """The segments without long gaps of some prepared recordings.

    Args:
        scene: the machine.
        parts: recordings, or parts of them.
        begun: activations of integrators where recordings began, (nu,), by index; zero of the rest.

    Raises:
        RecordingError: nothing is left.
    """
    segments = []
    for part in parts:
        recording, columns = part.recording, dict(part.recording.columns)
        for joint in scene.free:
            columns |= base.coordinates(joint, columns)
        t, command, known = commanded(scene, recording)
        # a part begins with what all commands before it have led to
        activation = activated(scene.model, t, command, (begun or {}).get(part.index))
        q, v = (
            _table(len(recording), columns, [f"{what}/{name}" for name in scene.joints])[known]
            for what in ("qpos", "qvel")
        )
        mine = (t >= part.span[0]) & (t < part.span[1])
        t, q, v, command, activation = (x[mine] for x in (t, q, v, command, activation))
        seen = np.flatnonzero(np.isfinite(q).any(axis=1))
        if len(seen) < 2:
            continue
        # short gaps are bridged by the spline; the commands recorded in them are kept
        dt = float(np.median(np.diff(t[seen])))
        ends = np.flatnonzero(np.diff(t[seen]) > max(LONG_GAP, 4.0 * dt)) + 1
        for part_seen in np.split(seen, ends):
            rows = slice(part_seen[0], part_seen[-1] + 1)
            if len(part_seen) >= 12 and t[part_seen[-1]] - t[part_seen[0]] >= SHORTEST:
                here = (t[rows], q[rows], v[rows], command[rows], activation[rows])
                segments.append(Samples(part.index, *here, _estimated(scene, recording)))
    if not segments:
        raise RecordingError(
            f"no stretch of {SHORTEST:g} s without a gap has commands and positions; "
            "record at an even rate, with every actuator's command"
        )
    return tuple(segments)


def commanded(
    scene: Scene, recording: Recording
) -> tuple[
    Float[np.ndarray, " commanded"],
    Float[np.ndarray, "commanded actuator"],
    Bool[np.ndarray, " sample"],
]:
    """Times [s] and commands of a recording's samples that have them all; and which these are."""
    t, m = stamps(recording), scene.model
    names = [f"ctrl/{m.actuator(i).name}" for i in range(m.nactuator)]
    command = _table(len(recording), recording.columns, names)
    known = np.isfinite(command).all(axis=1)
    return t[known], command[known], known


def _estimated(scene: Scene, recording: Recording) -> tuple[int, ...]:
    joints = recording.meta.get(ESTIMATED, ())
    assert isinstance(joints, tuple)
    return tuple(scene.dof(name) for joint in joints for name in base.names(joint))


def finer(s: Samples, count: int) -> Samples:
    """A segment with ``count`` commands for each sample; in between nothing else was measured."""
    index = np.arange(len(s.t))
    rows = np.arange((len(s.t) - 1) * count + 1)
    t = np.interp(rows / count, index, s.t)
    way = Akima1DInterpolator(s.t, s.command, axis=0, method="makima")
    q, v = (np.full((len(rows), x.shape[1]), np.nan) for x in (s.q, s.v))
    q[::count], v[::count] = s.q, s.v
    acted = np.stack([np.interp(t, s.t, x) for x in s.activation.T], axis=1)
    return replace(s, t=t, q=q, v=v, command=way(t), activation=acted)


def _table(
    length: int, columns: Mapping[str, Float[np.ndarray, " sample"]], names: Sequence[str]
) -> Float[np.ndarray, "sample column"]:
    missing = np.full(length, np.nan)
    table = [columns.get(name, missing) for name in names]
    return np.stack(table, axis=1) if table else np.zeros((length, 0))


def stamps(recording: Recording) -> Float[np.ndarray, " sample"]:
    """Time since the start [s]; jitter of the stamps is removed where the clock was even.

    If the measured positions lie on a smoother curve over an even grid (rounded by an isotonic
    regression, which drops and jitter do not upset) than over the stamps themselves, the stamps
    were late and not the samples.
    """
    t = recording.t - recording.t[0]
    dt = float(np.median(np.diff(t)))
    grid = _even(t, dt)
    if (np.diff(grid) <= 0).any() or np.abs(t - grid).max() > 1.5 * dt:
        return t
    rough = np.zeros(2)
    for name, column in recording.columns.items():
        if name.startswith("qpos/"):
            rough += _roughness([_deviations(clock, column) for clock in (t, grid)])
    return grid - grid[0] if rough[1] <= rough[0] * 1.02 else t


def _even(t: Float[np.ndarray, " sample"], dt: float) -> Float[np.ndarray, " sample"]:
    """The even grid, with gaps where samples were dropped, that stamps are closest to [s].

    The median interval is off by a little, over many samples by whole intervals; the interval is
    a whole part of the time in all, and the right part leaves the smallest error.
    """
    intervals = int(np.round(np.diff(t) / dt).sum())
    count = np.arange(len(t))
    best, error = t, np.inf
    for parts in range(max(intervals - _PARTS, len(t) - 1), intervals + _PARTS + 1):
        lag = isotonic_regression(t * parts / t[-1] - count).x
        even = np.round(lag - np.median(lag - np.round(lag))) + count
        # an average rate, not one interval: stamps are quantised
        slope, offset = np.polyfit(even, t, 1)
        grid = offset + even * slope
        if (left := float(np.square(t - grid).sum())) < error:
            best, error = grid, left
    return best


def _roughness(
    squares: Sequence[Float[np.ndarray, " sample"]],
) -> Float[np.ndarray, " clock"]:
    """How far samples are from a smooth curve on each of some clocks, from their squares.

    Where a motion jolts faster than the log, they are far from it on any clock, by so much that
    their sum tells nothing. So they count by their logarithm from where half of all are on the
    better clock, as with Cauchy's errors.
    """
    least = np.min(squares, axis=0)
    usual = max(float(np.median(least)), _TINY * float(least.mean()), _TINY**3)
    return np.array([np.log1p(square / usual).mean() for square in squares])


def _deviations(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " _"]:
    """Squared deviation of each sample from the cubic through its four neighbours."""
    ok = np.isfinite(x)
    t, x = t[ok], x[ok]
    if len(t) < 8:
        return np.zeros(1)
    rows = [t[i : len(t) - 4 + i] - t[2:-2] for i in (0, 1, 3, 4)]
    total = np.zeros(len(t) - 4)
    for i, k in enumerate((0, 1, 3, 4)):
        weight = np.ones_like(total)
        for j in range(4):
            if j != i:
                weight = weight * rows[j] / (rows[j] - rows[i])
        total += weight * x[k : len(x) - 4 + k]
    return np.asarray((total - x[2:-2]) ** 2)
