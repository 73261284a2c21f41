"""Smooth motions of recordings: noise, uneven stamps, gaps and a missing velocity handled.

A quintic spline is fitted by least squares to positions and velocities at their own time stamps,
so that position, velocity and acceleration come from one curve. How fine its knots are is chosen
by generalised cross-validation (P. Craven and G. Wahba, 1979), joint by joint. So is whether what
the model's drives make of commands that are held (:mod:`wt.diagnose.recordings.driven`) is left out
before, and added again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.interpolate import BSpline, PPoly
from scipy.sparse.linalg import splu

from wt.diagnose.recordings.driven import held
from wt.diagnose.recordings.grid import rounding
from wt.diagnose.recordings.odometry import UNSURE_Q, UNSURE_V
from wt.diagnose.recordings.samples import Part, Samples, commanded, finer, samples_of
from wt.physics import base
from wt.physics.activation import activated, dynamic, integrating
from wt.physics.motion import Motion, Segment
from wt.physics.scene import Scene

AtSamples = tuple[
    Float[np.ndarray, "_ dof"], Float[np.ndarray, "_ dof"], Float[np.ndarray, "_ dof"]
]
"""Smooth (q, v, a) at the time stamps of one segment's samples."""

DEGREE = 5
_KNOTS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)  # samples between knots that are tried
_COARSEST = 0.05  # s between knots: slower than any motion that matters
_TELLS, _CLEARLY = 0.1, 0.9
"""What jumps of commands move, in noise, from where curves beside the response to them are tried;
share of the score below which they are better."""
_STILL = 0.1  # rad/s or m/s: below, dry friction may be less than it is
_STEPS, _NUDGE = 8, 1e-6
"""Steps in which an integrator's begin is found, and by what its slope is taken [rad or m]."""
_MEAN_S = 0.1
"""Forces are compared in means of so long [s]: shorter than any motion that tells them apart."""
_TRIMS, _JOLT = 3, 5.0
"""Turns in which samples are left out whose errors are so many times the median."""
_TRIVIAL = 3e-3
"""Errors of forces that tell nothing, as a share of what the motion demands: steps of time, and the
smoothing, leave them too."""
FINEST_S = 3e-3
"""Even grids are no finer [s]: forces at 1 kHz say no more than at a third of the rate, and the
screen takes thrice the time."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Recordings, smoothed.

    Attributes:
        samples: the measured segments.
        motion: the smooth motion on an even grid, segment by segment, no finer than 3 ms.
        at_samples: per segment, smooth (q, v, a) at the measured time stamps.
        noise: standard deviation of a position sample [rad or m].
        noise_v: of a velocity sample; NaN where none was recorded.
        spacing: per segment and joint the spacing of knots, in measured samples.
        beside: likewise the response to held commands that the curve is beside; None if it is not.
        commands: for each measured sample; more than one where those between were filled in.
        begun: activations of integrators where each recording began, (nu,); zero of other drives.
    """

    samples: tuple[Samples, ...]
    motion: Motion
    at_samples: tuple[AtSamples, ...]
    noise: Float[np.ndarray, " dof"]
    noise_v: Float[np.ndarray, " dof"]
    spacing: tuple[tuple[float, ...], ...]
    beside: tuple[tuple[PPoly | None, ...], ...]
    commands: int = 1
    begun: Mapping[int, Float[np.ndarray, " actuator"]] = field(default_factory=dict)

    @cached_property
    def unsure(self) -> tuple[Float[np.ndarray, " state"], ...]:
        """Deviations of the smooth positions and velocities, segment by segment.

        A curve of fine knots, which follows fast motions, follows noise. A base that was computed
        from an IMU moves smoothly, and is off by more than that tells.
        """
        renewed, nv = resmooth(self, np.random.default_rng(0)), len(self.noise)
        least_q, least_v = np.zeros(nv), np.zeros(nv)
        scene, computed = self.motion.scene, {dof for s in self.samples for dof in s.estimated}
        for joint in scene.free:
            dofs = [scene.dof(name) for name in base.names(joint)]
            if computed.issuperset(dofs):
                least_q[dofs], least_v[dofs] = UNSURE_Q, UNSURE_V
        q = np.maximum(0.5 * np.nan_to_num(self.noise, nan=1.0), least_q)
        apart = renewed.v - self.motion.v
        each = [np.std(apart[segment.rows], axis=0) for segment in self.motion.segments]
        return tuple(np.concatenate([q, np.maximum(v, least_v)]) for v in each)


def smooth(
    scene: Scene,
    parts: Sequence[Part],
    commands: int = 1,
    begun: Mapping[int, Float[np.ndarray, " actuator"]] | None = None,
) -> Smoothed:
    """Smooth recordings of one machine.

    Args:
        scene: the machine.
        parts: recordings, or parts of them.
        commands: for each sample.
        begun: activations of integrators where recordings began, (nu,), as other parts of these
            showed them; those of the rest are estimated.

    Raises:
        RecordingError: nothing usable is in them.
    """
    samples = _measured(scene, parts, commands, begun)
    nv = scene.model.nv
    chosen = [_with_commands(scene, s, [_choose(s, joint) for joint in range(nv)]) for s in samples]
    rounded = np.array([rounding(parts, joint) for joint in scene.joints])
    noise = np.array([_pooled([c[j].sigma for c in chosen]) for j in range(nv)])
    noise = np.maximum(noise, rounded)
    noise_v = np.array([_pooled([c[j].sigma_v for c in chosen]) for j in range(nv)])
    smoothed = _assemble(scene, samples, chosen, noise, noise_v)
    if len(integrating(scene.model)):
        begun = {**_begun(smoothed, parts), **(begun or {})}
        samples = _measured(scene, parts, commands, begun)
        smoothed = _assemble(scene, samples, chosen, noise, noise_v)
    return replace(smoothed, commands=commands, begun=begun or {})


def _measured(
    scene: Scene,
    parts: Sequence[Part],
    commands: int,
    begun: Mapping[int, Float[np.ndarray, " actuator"]] | None,
) -> tuple[Samples, ...]:
    """The segments of recordings, with so many commands for each sample."""
    samples = samples_of(scene, parts, begun)
    return tuple(finer(s, commands) for s in samples) if commands > 1 else samples


def resmooth(smoothed: Smoothed, rng: np.random.Generator) -> Motion:
    """The smooth motion as it would come out of another draw of the measurement noise."""
    renewed = []
    for s, (q, v, _) in zip(smoothed.samples, smoothed.at_samples, strict=True):
        noisy_q = q + smoothed.noise * rng.standard_normal(q.shape)
        noisy_v = v + np.nan_to_num(smoothed.noise_v) * rng.standard_normal(v.shape)
        noisy_q[np.isnan(s.q)], noisy_v[np.isnan(s.v)] = np.nan, np.nan
        renewed.append(replace(s, q=noisy_q, v=noisy_v))
    nv = smoothed.noise.size
    chosen = [
        [
            _fit(s, j, spacing[j], smoothed.noise[j], smoothed.noise_v[j], beside[j])
            for j in range(nv)
        ]
        for s, spacing, beside in zip(renewed, smoothed.spacing, smoothed.beside, strict=True)
    ]
    scene = smoothed.motion.scene
    return _assemble(scene, tuple(renewed), chosen, smoothed.noise, smoothed.noise_v).motion


@dataclass(frozen=True, eq=False)
class _Curve:
    """A fitted spline of one joint in one segment, beside a response to commands or nothing."""

    spline: BSpline
    spacing: float
    sigma: float
    sigma_v: float
    score: float
    beside: PPoly | None = None

    def at(
        self, t: Float[np.ndarray, " time"], order: int, dt: float
    ) -> Float[np.ndarray, " time"]:
        """Position, velocity or acceleration.

        Args:
            t: when [s].
            order: of the derivative, 0 to 2.
            dt: interval in which accelerations are the mean, as the commands of a motion are [s].
        """
        value = np.asarray(self.spline(t, order))
        if self.beside is None:
            return value
        if order < 2:
            return value + self.beside(t, order)
        half = 0.5 * dt
        return value + (self.beside(t + half, 1) - self.beside(t - half, 1)) / dt


def _with_commands(scene: Scene, s: Samples, curves: list[_Curve]) -> list[_Curve]:
    """Curves beside the response to held commands, for the joints of which these are better."""
    rough = np.stack([c.spline(s.t) for c in curves], axis=1)
    commands = held(scene, s.t, rough, _acted_on(scene, s))
    if commands is None:
        return curves
    noises = np.array([(c.sigma, c.sigma_v) for c in curves]).T
    moved, turned = (x > _TELLS * noise for x, noise in zip(commands.jolts, noises, strict=True))
    known = commands.response() if (moved | turned).any() else None
    if known is None:
        return curves
    found = list(curves)
    for joint in np.flatnonzero(moved | turned).tolist():
        other = _choose(s, joint, PPoly(known.c[:, :, joint], known.x))
        if other.score < _CLEARLY * curves[joint].score:
            found[joint] = other
    return found


def _choose(s: Samples, joint: int, beside: PPoly | None = None) -> _Curve:
    """The curve whose knots generalised cross-validation prefers."""
    best: _Curve | None = None
    seen = s.t[np.isfinite(s.q[:, joint])]
    apart = float(np.median(np.diff(seen))) if len(seen) > 1 else s.dt
    for spacing in _KNOTS:
        if best is not None and spacing * apart > _COARSEST:
            break
        curve = _fit(s, joint, spacing, 1.0, np.nan, beside)
        if best is None or curve.score < 0.995 * best.score:
            best = curve
    assert best is not None
    if np.isfinite(s.v[:, joint]).mean() < 0.5:
        return best
    return _fit(s, joint, best.spacing, best.sigma, best.sigma_v, beside)


def _fit(
    s: Samples,
    joint: int,
    spacing: float,
    sigma: float,
    sigma_v: float,
    beside: PPoly | None = None,
) -> _Curve:
    """Least squares spline through positions and, if ``sigma_v`` is finite, velocities."""
    ok = np.isfinite(s.q[:, joint])
    if ok.sum() < 4 * DEGREE:
        return _Curve(_constant(s.t, 0.0), spacing, np.nan, np.nan, np.inf)
    t, x, v = s.t[ok], s.q[ok, joint], s.v[:, joint]
    if beside is not None:
        x, v = x - beside(t), v - beside(s.t, 1)
    inner = _inner(s, t, spacing)
    knots = np.concatenate([np.repeat(inner[0], DEGREE), inner, np.repeat(inner[-1], DEGREE)])
    design = BSpline.design_matrix(t, knots, DEGREE)
    normal = (design.T @ design) / sigma**2
    right = design.T @ x / sigma**2
    n = design.shape[1]
    with_v = np.isfinite(v)
    if np.isfinite(sigma_v) and with_v.any():
        slope = _derivative(knots, n)
        design_v = BSpline.design_matrix(s.t[with_v], knots[1:-1], DEGREE - 1) @ slope
        normal = normal + (design_v.T @ design_v) / sigma_v**2
        right = right + design_v.T @ v[with_v] / sigma_v**2
    # third differences, as weak as can be: coefficients that no sample supports stay defined
    third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(n - 3, n))
    ridge = 1e-9 * normal.diagonal().max()
    coefficients = splu((normal + ridge * (third.T @ third)).tocsc()).solve(right)
    spline = BSpline(knots, coefficients, DEGREE)
    left = x - design @ coefficients
    free = max(len(t) - n, 1)
    rms = _core_deviation(left) * float(np.sqrt(len(t) / free))
    # GCV = N·RSS / (N − p)², with p the number of coefficients
    score = float(len(t) * (left @ left) / free**2)
    rate = np.nan
    if with_v.any():
        error = v[with_v] - spline(s.t[with_v], 1)
        rate = float(np.sqrt(np.mean(error**2)))
    return _Curve(spline, spacing, max(rms, 1e-9), rate, score, beside)


def _inner(
    s: Samples, t: Float[np.ndarray, " measured"], spacing: float
) -> Float[np.ndarray, " knot"]:
    """Knots so many samples apart from the first to the last of a segment, measured at ``t``.

    They follow the samples and not the clock: between two that are far apart, nothing is known.
    """
    # as many spaces as come nearest, in doubt one fewer
    spaces = max(1, int(np.ceil((len(t) - 1) / spacing - 0.5)))
    index = np.linspace(0.0, len(t) - 1.0, spaces + 1)
    knots = np.interp(index, np.arange(len(t)), t)
    knots[0], knots[-1] = s.t[0], s.t[-1]
    return knots


def _core_deviation(left: Float[np.ndarray, " sample"]) -> float:
    """Standard deviation of the middle 80 %, as of a normal distribution.

    Where a motion is faster than the knots, a few residuals are large that are no noise.
    """
    size = np.sort(np.abs(left))[: max(int(0.8 * len(left)), 1)]
    # variance of a normal distribution cut off at its 80 % quantile: 0.4377
    return float(np.sqrt(np.mean(size**2) / 0.4377))


def _derivative(knots: Float[np.ndarray, " knot"], n: int) -> sparse.spmatrix:
    """Coefficients of the derivative spline from those of the spline, (n − 1, n)."""
    gap = knots[DEGREE + 1 : DEGREE + n] - knots[1:n]
    factor = DEGREE / gap
    return sparse.diags([-factor, factor], [0, 1], shape=(n - 1, n)).tocsc()


def _acted_on(scene: Scene, s: Samples) -> Float[np.ndarray, "sample actuator"]:
    """What each drive acts on from each sample to the next: its command, or a mean activation."""
    following = np.concatenate([s.activation[1:], s.activation[-1:]])
    return np.where(dynamic(scene.model), 0.5 * (s.activation + following), s.activation)


def _begun(smoothed: Smoothed, parts: Sequence[Part]) -> dict[int, Float[np.ndarray, " actuator"]]:
    """Activations of integrators where each recording began, of which nothing recorded says.

    They began where forces balance in the mean of a recording, but for what follows the motion:
    friction, inertia, or a share of all, where any of these shows. At the ends of its range
    an activation forgets where it began, so that this is found in steps.
    """
    motion, model = smoothed.motion, smoothed.motion.scene.model
    begun = {part.index: np.zeros(model.nactuator) for part in parts}
    for part in parts:
        rows = np.zeros(len(motion.t), bool)
        for segment in motion.segments:  # at its very ends a curve's slope is loose
            end = round(_MEAN_S / segment.dt)
            inner = slice(segment.rows.start + end, segment.rows.stop - end)
            rows[inner] |= segment.recording == part.index
        t, command, _ = commanded(motion.scene, part.recording)
        start, given = begun[part.index], activated(model, t, command)
        for drive in (d for d in motion.scene.drives if d.index in integrating(model)):
            i, force, v = drive.index, drive.gear * drive.gain, motion.v[rows, drive.dof]
            following = [np.tanh(v / _STILL), v, motion.a[rows, drive.dof]]
            following.append(motion.demand[rows, drive.dof])
            for _ in range(_STEPS):
                nudged = start.copy()
                nudged[i] += _NUDGE
                acted, moved = (activated(model, t, command, x)[:, i] for x in (start, nudged))
                since, slope = (
                    np.interp(motion.t[rows], t, x)
                    for x in (acted - given[:, i], (moved - acted) / _NUDGE)
                )
                lacking = motion.unexplained[rows, drive.dof] - force * since
                columns = np.stack([slope, *following, lacking], axis=1)
                step = _shared(_means(columns, max(1, round(_MEAN_S / motion.dt)))) / force
                start[i] += step
                if abs(step) < _NUDGE:
                    break
    return begun


def _means(x: Float[np.ndarray, "sample column"], count: int) -> Float[np.ndarray, "_ column"]:
    """Means of each ``count`` samples: noise of accelerations is in every force that has them."""
    whole = len(x) // count * count
    return np.asarray(x[:whole].reshape(-1, count, x.shape[1]).mean(axis=1))


def _shared(columns: Float[np.ndarray, "row column"]) -> float:
    """Coefficient of the first column in the last; the others contribute only if they show.

    The last but one is the force that the motion demands.

    A weight that hardly changes looks like the begin of an integrator, and the least error of a
    model would be given to both. So each other force must be worth its parameter by the Bayesian
    information criterion (G. Schwarz, 1978); so many samples are independent as errors change sign.
    Jolts, which no smooth motion follows, are left out.
    """
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-12
    columns, trivial = columns / scale, _TRIVIAL * scale[-2] / scale[-1]
    others = range(1, columns.shape[1] - 1)
    subsets = [(0, *c) for n in range(len(others) + 1) for c in combinations(others, n)]
    for _ in range(_TRIMS):
        left = _left(columns, subsets[-1])
        columns = columns[np.abs(left) <= _JOLT * np.median(np.abs(left)) + trivial]
    left = _left(columns, subsets[-1])
    small = np.asarray(np.linalg.qr(columns, mode="r"))  # with the same least squares
    independent = max(int(np.count_nonzero(np.diff(np.sign(left)))), 1)

    def criterion(subset: tuple[int, ...]) -> float:
        mse = float(np.sum(_left(small, subset) ** 2)) / len(columns)
        parameters = len(subset) * np.log(independent)
        return float(independent * np.log(mse + trivial**2) + parameters)

    best = min(subsets, key=criterion)
    return float(_least(small, best)[0] * scale[-1] / scale[0])


def _least(columns: Float[np.ndarray, "row column"], subset: tuple[int, ...]) -> np.ndarray:
    """Coefficients of some columns that come nearest to the last one."""
    return np.asarray(np.linalg.lstsq(columns[:, subset], columns[:, -1], rcond=1e-6)[0])


def _left(
    columns: Float[np.ndarray, "row column"], subset: tuple[int, ...]
) -> Float[np.ndarray, " row"]:
    """What some columns leave of the last one."""
    return np.asarray(columns[:, -1] - columns[:, subset] @ _least(columns, subset))


def _constant(t: Float[np.ndarray, " sample"], value: float) -> BSpline:
    knots = np.concatenate([np.repeat(t[0], DEGREE + 1), np.repeat(t[-1], DEGREE + 1)])
    return BSpline(knots, np.full(DEGREE + 1, value), DEGREE)


def _pooled(deviations: Sequence[float]) -> float:
    finite = [d for d in deviations if np.isfinite(d)]
    return float(np.median(finite)) if finite else np.nan


def _assemble(
    scene: Scene,
    samples: tuple[Samples, ...],
    chosen: Sequence[Sequence[_Curve]],
    noise: Float[np.ndarray, " dof"],
    noise_v: Float[np.ndarray, " dof"],
) -> Smoothed:
    """Evaluate the curves on even grids and at the stamps."""
    parts, segments, at_samples, start = [], [], [], 0
    for s, curves in zip(samples, chosen, strict=True):
        every = max(1, int(FINEST_S / s.dt + 1e-6))
        dt = every * s.dt
        count = int((s.t[-1] - s.t[0]) / dt + 1e-6) + 1
        fine = s.t[0] + s.dt * np.arange(count * every)
        # the command in force is the last one sent; until the next grid point, their mean
        last = np.clip(np.searchsorted(s.t, fine + 1e-6 * s.dt, side="right") - 1, 0, len(s.t) - 1)
        command = _acted_on(scene, s)[last].reshape(count, every, -1).mean(axis=1)
        grid = fine[::every]
        on_grid = [np.stack([c.at(grid, d, dt) for c in curves], axis=1) for d in range(3)]
        parts.append((grid, *on_grid, command))
        segments.append(Segment(slice(start, start + count), s.recording, dt))
        start += count
        q, v, a = (np.stack([c.at(s.t, d, s.dt) for c in curves], axis=1) for d in range(3))
        at_samples.append((q, v, a))
    t, q, v, a, command = (np.concatenate(x) for x in zip(*parts, strict=True))
    motion = Motion(scene, tuple(segments), t, q, v, a, command)
    spacing = tuple(tuple(c.spacing for c in curves) for curves in chosen)
    beside = tuple(tuple(c.beside for c in curves) for curves in chosen)
    return Smoothed(samples, motion, tuple(at_samples), noise, noise_v, spacing, beside)
