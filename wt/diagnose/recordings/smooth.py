"""Smooth motions of recordings: noise, uneven stamps, gaps and a missing velocity handled.

A quintic spline is fitted by least squares to positions and velocities at their own time stamps,
so that position, velocity and acceleration come from one curve. How fine its knots are is chosen
by generalised cross-validation (P. Craven and G. Wahba, 1979), joint by joint. For states, so is
whether what the model's drives make of commands that are held is left out before and added again
(:mod:`wt.diagnose.recordings.driven`). Forces are of splines alone, whose accelerations are means
over a knot: at one moment, a command that came a thousandth later than stamped moves them by more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PPoly

from wt.diagnose.recordings.colour import Noise
from wt.diagnose.recordings.curves import Curve, choose, fit
from wt.diagnose.recordings.driven import as_found, held, responds_otherwise
from wt.diagnose.recordings.grid import rounding
from wt.diagnose.recordings.odometry import UNSURE_Q, UNSURE_V
from wt.diagnose.recordings.samples import Part, Samples, commanded, finer, samples_of
from wt.physics import base
from wt.physics.activation import activated, dynamic, integrating
from wt.physics.motion import Motion, Segment
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene

AtSamples = tuple[
    Float[np.ndarray, "_ dof"], Float[np.ndarray, "_ dof"], Float[np.ndarray, "_ dof"]
]
"""Smooth (q, v, a) at the time stamps of one segment's samples."""

_TELLS, _CLEARLY = 0.1, 0.9
"""What jumps of commands move, in noise, from where curves beside the response to them are tried;
share of the score below which they are better."""
_FOLLOWING = 0.5
"""Share of a joint's widest spacing of knots up to which curves follow most of coloured noise."""
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
        motion: the smooth motion on an even grid, segment by segment, no finer than 3 ms, of
            ``splines``.
        at_samples: per segment, smooth (q, v, a) at the measured time stamps.
        noise: standard deviation of a position sample [rad or m].
        colour: correlation of the noise of neighbouring ones; 0 where that is white.
        noise_v: of a velocity sample; NaN where none was recorded.
        curves: per segment and joint what states are read off, beside the response to held commands
            where that is better.
        splines: likewise what forces are of.
        missed: deviations of samples from the splines: noise, and what is faster.
        commands: for each measured sample; more than one where those between were filled in.
        begun: activations of integrators where each recording began, (nu,); zero of other drives.
    """

    samples: tuple[Samples, ...]
    motion: Motion
    at_samples: tuple[AtSamples, ...]
    noise: Float[np.ndarray, " dof"]
    noise_v: Float[np.ndarray, " dof"]
    colour: Float[np.ndarray, " dof"]
    curves: tuple[tuple[Curve, ...], ...]
    splines: tuple[tuple[Curve, ...], ...]
    missed: Noise
    commands: int = 1
    begun: Mapping[int, Float[np.ndarray, " actuator"]] = field(default_factory=dict)

    @property
    def spacing(self) -> tuple[tuple[float, ...], ...]:
        """Spacing of the curves' knots, per segment and joint, in measured samples."""
        return tuple(tuple(c.spacing for c in curves) for curves in self.curves)

    @cached_property
    def unsure(self) -> tuple[Float[np.ndarray, " state"], ...]:
        """Deviations of the smooth positions and velocities, segment by segment.

        A curve of fine knots, which follows fast motions, follows noise, and any curve what is slow
        of coloured noise. A base that was computed from an IMU moves smoothly, and is off by more
        than that tells.
        """
        noise = Noise(self.noise, self.colour, self.noise_v)
        samples = _redrawn(self, noise, np.random.default_rng(0))
        least_q, least_v = np.zeros(len(self.noise)), np.zeros(len(self.noise))
        scene, computed = self.motion.scene, {dof for s in self.samples for dof in s.estimated}
        for joint in scene.free:
            dofs = [scene.dof(name) for name in base.names(joint)]
            if computed.issuperset(dofs):
                least_q[dofs], least_v[dofs] = UNSURE_Q, UNSURE_V
        q = np.maximum(0.5 * np.nan_to_num(self.noise, nan=1.0), least_q)
        each = []
        for segment, new, known in zip(
            self.motion.segments,
            _refitted(samples, self.curves, noise),
            self.curves,
            strict=True,
        ):
            grid = self.motion.t[segment.rows]
            off, off_v = (
                np.std(_at(grid, new, order) - _at(grid, known, order), axis=0) for order in (0, 1)
            )
            off = np.where(self.colour > 0.0, np.maximum(q, off), q)
            each.append(np.concatenate([off, np.maximum(off_v, least_v)]))
        return tuple(each)


def smooth(
    scene: Scene,
    parts: Sequence[Part],
    commands: int = 1,
    begun: Mapping[int, Float[np.ndarray, " actuator"]] | None = None,
    known: Hypothesis = (),
) -> Smoothed:
    """Smooth recordings of one machine.

    Args:
        scene: the machine.
        parts: recordings, or parts of them.
        commands: for each sample.
        begun: activations of integrators where recordings began, (nu,), as other parts of these
            showed them; those of the rest are estimated.
        known: effects of the machine that the model lacks, for its response to commands.

    Raises:
        RecordingError: nothing usable is in them.
    """
    samples = _measured(scene, parts, commands, begun)
    nv = scene.model.nv
    splines = [tuple(choose(s, joint) for joint in range(nv)) for s in samples]
    rounded = np.array([rounding(parts, joint) for joint in scene.joints])
    missed = _noise(splines)
    chosen = _curves(scene, samples, splines, known)
    motion = _motion(scene, samples, splines)
    if len(integrating(scene.model)):
        begun = {**_begun(motion, parts), **(begun or {})}
        samples = _measured(scene, parts, commands, begun)
        motion = _motion(scene, samples, splines)
    missed = replace(missed, deviation=np.maximum(missed.deviation, rounded))
    aside = tuple(splines), missed
    states = _states(samples, chosen, rounded)
    return Smoothed(samples, motion, *states, *aside, commands, begun or {})


def beside(smoothed: Smoothed, parts: Sequence[Part], known: Hypothesis) -> Smoothed:
    """Recordings whose states are read beside the response of the model with what was found.

    Args:
        smoothed: the recordings.
        parts: what they are of.
        known: effects of the machine that the model lacks.

    Returns:
        The same object where that response is the given model's, or moves no curve by more than
        a tenth of its noise.
    """
    scene, samples = smoothed.motion.scene, smoothed.samples
    if scene.free or not responds_otherwise(scene, known):
        return smoothed
    rounded = np.array([rounding(parts, joint) for joint in scene.joints])
    chosen = _curves(scene, samples, smoothed.splines, known)
    at_samples, noise, noise_v, colour, curves = _states(samples, chosen, rounded)
    before, after = (
        np.concatenate([q for q, *_ in each]) for each in (smoothed.at_samples, at_samples)
    )
    moved = np.sqrt(np.mean((after - before) ** 2, axis=0))
    if not (moved > _TELLS * noise).any():
        return smoothed
    again = replace(smoothed, at_samples=at_samples, curves=curves)
    return replace(again, noise=noise, noise_v=noise_v, colour=colour)


def _curves(
    scene: Scene,
    samples: Sequence[Samples],
    splines: Sequence[tuple[Curve, ...]],
    known: Hypothesis,
) -> list[tuple[Curve, ...]]:
    """Per segment and joint what states are read off."""
    model, pairs = as_found(scene, known), zip(samples, splines, strict=True)
    return [_with_commands(scene, s, own, model, known) for s, own in pairs]


def _states(
    samples: Sequence[Samples],
    curves: Sequence[tuple[Curve, ...]],
    rounded: Float[np.ndarray, " dof"],
) -> tuple[
    tuple[AtSamples, ...],
    Float[np.ndarray, " dof"],
    Float[np.ndarray, " dof"],
    Float[np.ndarray, " dof"],
    tuple[tuple[Curve, ...], ...],
]:
    """Smooth states at the samples, noise of positions, of velocities, its colour, the curves."""
    at_samples = tuple(
        (_at(s.t, own, 0), _at(s.t, own, 1), _at(s.t, own, 2))
        for s, own in zip(samples, curves, strict=True)
    )
    noise = _noise(curves)
    deviation = np.maximum(noise.deviation, rounded)
    return at_samples, deviation, noise.deviation_v, noise.colour, tuple(curves)


def _noise(curves: Sequence[Sequence[Curve]]) -> Noise:
    """Noise of each joint in all segments, by what curves leave.

    Where one shows that it is coloured, those tell nothing that have so fine knots that they follow
    most of it.
    """
    joints = list(zip(*curves, strict=True))
    sigma_v = [_pooled([c.sigma_v for c in own]) for own in joints]
    telling = []
    for own in joints:
        least = _FOLLOWING * max(c.spacing for c in own) if any(c.colour for c in own) else 0.0
        telling.append([c for c in own if c.spacing > least])
    sigma, colour = (
        np.array([_pooled([getattr(c, name) for c in own]) for own in telling])
        for name in ("sigma", "colour")
    )
    return Noise(sigma, np.nan_to_num(colour), np.array(sigma_v))


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
    """The smooth motion as it would come out of another draw of what splines miss."""
    renewed = _redrawn(smoothed, smoothed.missed, rng)
    again = _refitted(renewed, smoothed.splines, smoothed.missed)
    return _motion(smoothed.motion.scene, renewed, again)


def _redrawn(smoothed: Smoothed, noise: Noise, rng: np.random.Generator) -> tuple[Samples, ...]:
    """The segments with another draw of noise."""
    renewed = []
    for s, (q, v, _) in zip(smoothed.samples, smoothed.at_samples, strict=True):
        noise_q, noise_v = noise.drawn(len(q), rng)
        noisy_q, noisy_v = q + noise_q, v + noise_v
        noisy_q[np.isnan(s.q)], noisy_v[np.isnan(s.v)] = np.nan, np.nan
        renewed.append(replace(s, q=noisy_q, v=noisy_v))
    return tuple(renewed)


def _refitted(
    samples: Sequence[Samples], curves: Sequence[Sequence[Curve]], noise: Noise
) -> tuple[tuple[Curve, ...], ...]:
    """Curves of the same kind through samples of so much noise."""
    size, size_v, white = noise.deviation, noise.deviation_v, noise.colour == 0.0

    def again(s: Samples, joint: int, c: Curve) -> Curve:
        weight = float(size[joint]) if white[joint] else c.left
        return fit(s, joint, c.spacing, weight, float(size_v[joint]), c.beside, c.knots)

    return tuple(
        tuple(again(s, j, c) for j, c in enumerate(own))
        for s, own in zip(samples, curves, strict=True)
    )


def _at(
    t: Float[np.ndarray, " time"], curves: Sequence[Curve], order: int
) -> Float[np.ndarray, "time dof"]:
    """Positions of all joints, or a derivative of them."""
    return np.stack([c.at(t, order) for c in curves], axis=1)


def _with_commands(
    scene: Scene,
    s: Samples,
    curves: tuple[Curve, ...],
    model: mujoco.MjModel,
    known: Hypothesis,
) -> tuple[Curve, ...]:
    """Curves beside the response to held commands, for the joints of which these are better."""
    commands = held(scene, s.t, _at(s.t, curves, 0), _acted_on(scene, s), model, known)
    if commands is None:
        return curves
    noises = np.array([(c.sigma, c.sigma_v) for c in curves]).T
    moved, turned = (x > _TELLS * noise for x, noise in zip(commands.jolts, noises, strict=True))
    response = commands.response() if (moved | turned).any() else None
    if response is None:
        return curves
    found = list(curves)
    for joint in np.flatnonzero(moved | turned).tolist():
        other = choose(s, joint, PPoly(response.c[:, :, joint], response.x))
        if other.score < _CLEARLY * curves[joint].score:
            found[joint] = other
    return tuple(found)


def _acted_on(scene: Scene, s: Samples) -> Float[np.ndarray, "sample actuator"]:
    """What each drive acts on from each sample to the next: its command, or a mean activation."""
    following = np.concatenate([s.activation[1:], s.activation[-1:]])
    return np.where(dynamic(scene.model), 0.5 * (s.activation + following), s.activation)


def _begun(motion: Motion, parts: Sequence[Part]) -> dict[int, Float[np.ndarray, " actuator"]]:
    """Activations of integrators where each recording began, of which nothing recorded says.

    They began where forces balance in the mean of a recording, but for what follows the motion:
    friction, inertia, or a share of all, where any of these shows. At the ends of its range
    an activation forgets where it began, so that this is found in steps.
    """
    model = motion.scene.model
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


def _pooled(deviations: Sequence[float]) -> float:
    finite = [d for d in deviations if np.isfinite(d)]
    return float(np.median(finite)) if finite else np.nan


def _motion(scene: Scene, samples: Sequence[Samples], curves: Sequence[Sequence[Curve]]) -> Motion:
    """Evaluate curves on even grids."""
    parts, segments, start = [], [], 0
    for s, of_segment in zip(samples, curves, strict=True):
        every = max(1, int(FINEST_S / s.dt + 1e-6))
        dt = every * s.dt
        count = int((s.t[-1] - s.t[0]) / dt + 1e-6) + 1
        fine = s.t[0] + s.dt * np.arange(count * every)
        # the command in force is the last one sent; until the next grid point, their mean
        last = np.clip(np.searchsorted(s.t, fine + 1e-6 * s.dt, side="right") - 1, 0, len(s.t) - 1)
        command = _acted_on(scene, s)[last].reshape(count, every, -1).mean(axis=1)
        grid = fine[::every]
        parts.append((grid, *(_at(grid, of_segment, order) for order in range(3)), command))
        segments.append(Segment(slice(start, start + count), s.recording, dt))
        start += count
    t, q, v, a, command = (np.concatenate(x) for x in zip(*parts, strict=True))
    return Motion(scene, tuple(segments), t, q, v, a, command)
