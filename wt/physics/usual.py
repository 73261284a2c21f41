"""What models are usually off by, taken out of a force residual: events in time then stand out.

No model has the very inertia, drive and friction of its machine. Errors of a few per cent of large
forces that nearly cancel hide a push that is smaller than each of them. But they follow the motion
in a known way, in all joints together, and a push does not: so they are fitted first, by robust
least squares with priors, and once more without the moments that they did not explain.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from wt.physics import inertia
from wt.physics.motion import Motion

SMOOTH_S = 0.05
"""Deviation [s] of the bell by which forces are smoothed before they are compared."""
_INERTIA, _ARMATURE, _GAIN, _LOAD, _LATE_S = 0.05, 1.0, 0.03, 0.05, 0.005
"""Deviations of a body's inertial parameters, a joint's armature and a drive's gain [shares], of
friction in proportion to a drive's force [share] and of the time that a drive answers in [s]."""
_STILL, _MOVING = 0.1, 0.3
"""Speeds [rad/s or m/s]: below the one dry friction holds a joint, above the other it has slid."""
EDGE_S = 0.25
"""At either end of a segment, where a smooth curve is loose [s]."""
_LEAST_S = 1.5
"""Least time that says what is usual [s]."""
_EVERY_S, MOMENT_S = 0.03, 3.5 * SMOOTH_S
"""Time between moments that are fitted, and after which one is new [s]."""
_OUTLIER, _STEPS = 1.5, 12
"""Robust deviations from which a moment counts less; reweightings."""
_EVENT, _AROUND = 6.0, 4.0
"""Robust deviations from which a moment is no error of the model, and deviations of the bell around
it that are left out with it."""


class Unusual(NamedTuple):
    """What is left of a force residual.

    Attributes:
        force: that is left, (T, nv) [N·m].
        deviation: robust deviation of it, smoothed, of each joint while it moves, (nv,) [N·m].
        dry: dry friction of each joint, (nv,) [N·m].
        still: share of the time around each sample in which friction holds a joint, (T, nv).
    """

    force: Float[np.ndarray, "sample dof"]
    deviation: Float[np.ndarray, " dof"]
    dry: Float[np.ndarray, " dof"]
    still: Float[np.ndarray, "sample dof"]


@lru_cache(maxsize=8)
def unusual(motion: Motion) -> Unusual:
    """The force residual of recordings without what models are usually off by.

    Of a machine on feet it is all that contacts cannot supply: what they do supply is not known.
    What is usual in less than a second or two is not known either, so that nothing stands out.
    """
    left, weight = motion.unexplained, _weight(motion)
    nothing = np.zeros_like(left)
    if weight.any(axis=1).sum() * motion.dt < _LEAST_S:
        return Unusual(left, np.full(left.shape[1], np.inf), nothing[0], nothing)
    if motion.scene.free:
        return Unusual(left, _deviation(smoothed(motion, left), weight), nothing[0], nothing)
    columns, priors = _errors(motion)
    design, target = smoothed(motion, columns), smoothed(motion, left)
    for _ in range(2):
        x = _fitted(motion, design, target, weight, priors)
        error = target - design @ x
        deviation = _deviation(error, weight)
        event = (np.abs(error) > _EVENT * deviation).any(axis=1)
        rest = weight * ~_around(motion, event)[:, None]
        if rest.any(axis=1).sum() * motion.dt < _LEAST_S:
            break
        weight = rest
    of_joints = x[-_JOINT * len(deviation) :].reshape(len(deviation), _JOINT)
    dry = np.maximum(motion.scene.model.dof_frictionloss - of_joints[:, :_DRY].sum(axis=1), 0.0)
    still = smoothed(motion, (np.abs(motion.v) < _STILL).astype(float))
    return Unusual(left - columns @ x, deviation, dry, still)


def smoothed(
    motion: Motion, force: Float[np.ndarray, " sample *column"]
) -> Float[np.ndarray, " sample *column"]:
    """A force smoothed by a bell, segment by segment.

    Most errors act on few of a robot's joints, and nothing stays nothing.
    """
    acting, out = force.any(axis=0), np.zeros_like(force)
    for s in motion.segments:
        out[s.rows, acting] = gaussian_filter1d(force[s.rows, acting], SMOOTH_S / s.dt, axis=0)
    return out


_JOINT, _DRY = 9, 2  # errors of each joint, of which the first are dry friction


def _errors(
    motion: Motion,
) -> tuple[Float[np.ndarray, "sample dof error"], Float[np.ndarray, " error"]]:
    """Force of each error, and its deviation; infinite where anything may be."""
    scene, columns, priors = motion.scene, [], list[float]()
    for body in scene.moving:
        mass, centre, moments = inertia.own(scene, body)
        spread = float(np.trace(moments)) + mass * float(centre @ centre)
        # as large as those of a body of this mass and spread
        sizes = [mass, *[np.sqrt(mass * spread)] * 3, *[spread] * 6]
        columns.append(inertia.demand(motion.recorded, body) * np.array(sizes))
        priors += [_INERTIA] * len(sizes)
    for dof, armature in enumerate(scene.model.dof_armature):
        v, drive = motion.v[:, dof], motion.drive_forces[:, dof]
        late = np.concatenate([np.gradient(drive[s.rows], s.dt) for s in motion.segments])
        dry, soft = np.tanh(v / _STILL), np.tanh(v / (2.0 * _MOVING))
        friction = [dry, soft, v, v * np.abs(v), np.ones(len(v))]
        driven = [drive, late, dry * np.abs(drive), armature * motion.a[:, dof]]
        columns.append(motion.on(dof, *friction, *driven))
        priors += [*[np.inf] * len(friction), _GAIN, _LATE_S, _LOAD, _ARMATURE]
    return np.concatenate(columns, axis=2), np.array(priors)


def _fitted(
    motion: Motion,
    design: Float[np.ndarray, "sample dof error"],
    target: Float[np.ndarray, "sample dof"],
    weight: Float[np.ndarray, "sample dof"],
    priors: Float[np.ndarray, " error"],
) -> Float[np.ndarray, " error"]:
    """Size of each error, by reweighted least squares."""
    every = max(1, round(_EVERY_S / motion.dt))
    rows = np.flatnonzero(weight.any(axis=1))[::every]
    design, target = design[rows], target[rows]
    counts = weight[rows] * every * motion.dt / MOMENT_S
    x = np.zeros(len(priors))
    for _ in range(_STEPS):
        error = target - design @ x
        usual = _deviation(error, counts)
        w = counts / (usual * np.maximum(1.0, np.abs(error) / (_OUTLIER * usual))) ** 2
        flat = (design * w[:, :, None]).reshape(-1, len(x))
        gram = flat.T @ design.reshape(-1, len(x)) + np.diag(priors**-2.0)
        size = np.sqrt(np.diag(gram)) + 1e-12
        scaled = gram / np.outer(size, size) + 1e-9 * np.eye(len(x))
        x = np.linalg.solve(scaled, flat.T @ target.reshape(-1) / size) / size
    return x


def _weight(motion: Motion) -> Float[np.ndarray, "sample dof"]:
    """Share of the time around each sample that a joint moves for."""
    moving = np.abs(motion.v) > _MOVING
    moving[:, moving.mean(axis=0) < 0.2] = True
    inside = np.zeros(len(motion), bool)
    for s in motion.segments:
        edge = round(EDGE_S / s.dt)
        inside[s.rows.start + edge : s.rows.stop - edge] = True
    return smoothed(motion, moving.astype(float)) * (motion.calm & inside)[:, None]


def _deviation(
    error: Float[np.ndarray, "sample dof"], weight: Float[np.ndarray, "sample dof"]
) -> Float[np.ndarray, " dof"]:
    """Robust deviation of each joint's error where it counts."""
    counted = np.where(weight > 0.3 * weight.max(axis=0), np.abs(error), np.nan)
    return 1.4826 * np.nan_to_num(np.nanmedian(counted, axis=0)) + 1e-12


def _around(motion: Motion, event: Bool[np.ndarray, " sample"]) -> Bool[np.ndarray, " sample"]:
    """Samples so close to an event that a smoothed force has some of it, (T,)."""
    near = np.zeros_like(event)
    for s in motion.segments:
        width = 2 * round(_AROUND * SMOOTH_S / s.dt) + 1
        near[s.rows] = maximum_filter1d(event[s.rows], width)
    return near
