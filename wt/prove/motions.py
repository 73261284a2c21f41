"""Reference motions: positions over time that a position-controlled robot is sent.

Every motion stays within ``middle ± amplitude`` of each joint, and starts and ends anywhere in
it. All are deterministic in their generator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline

Motion = Literal["multisine", "triangle", "moves", "jumps", "chirp", "holds", "mixture"]
Shape = Callable[[Float[np.ndarray, " sample"], np.random.Generator], Float[np.ndarray, " sample"]]
"""Unit motion of one joint, mostly within ±1, at given times [s]."""
MOTIONS: tuple[str, ...] = get_args(Motion)


def reference(
    kind: str,
    t: Float[np.ndarray, " sample"],
    middle: Float[np.ndarray, " joint"],
    amplitude: Float[np.ndarray, " joint"],
    tempo: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"]:
    """Positions of one motion.

    Args:
        kind: one of ``MOTIONS``, or ``creep``.
        t: times [s].
        middle: centre of each joint's motion [rad].
        amplitude: largest excursion of each joint [rad].
        tempo: 1 for peak speeds of about 1.5 rad/s.
        rng: draws all that is free.

    Returns:
        Positions [rad].
    """
    if kind == "mixture":
        return _mixture(t, middle, amplitude, tempo, rng)
    make = SHAPES[kind]
    unit = np.stack([make(t * tempo, rng) for _ in middle], axis=1)
    return np.asarray(middle + amplitude * np.clip(unit, -1.0, 1.0))


def _multisine(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    f = rng.uniform(0.08, 0.9, 5)
    weight = rng.uniform(0.5, 1.0, 5) / (0.3 + f)
    wave = (weight * np.sin(2 * np.pi * (f * t[:, None] + rng.random(5)))).sum(axis=1)
    return np.asarray(wave / np.abs(wave).max())


def _triangle(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Constant slow speeds with sharp reversals, each leg to another end."""
    times, ends = [t[0] - 2.0], [float(rng.uniform(-1, 1))]
    while times[-1] < t[-1]:
        end = float(np.sign(-ends[-1] + 1e-9) * rng.uniform(0.1, 1.0))
        speed = float(np.exp(rng.uniform(np.log(0.04), np.log(0.8))))
        times.append(times[-1] + max(abs(end - ends[-1]) / speed, 0.15))
        # long slow legs are cut, so that a recording has several reversals
        if times[-1] - times[-2] > 4.0:
            end = ends[-1] + np.sign(end - ends[-1]) * speed * 4.0
            times[-1] = times[-2] + 4.0
        ends.append(float(end))
    return np.interp(t, times, ends)


def _moves(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Minimum-jerk moves between random targets, with rests."""
    return _targets(t, rng, travel=(0.5, 1.3), rest=(0.1, 1.0))


def _holds(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Long rests at random targets."""
    return _targets(t, rng, travel=(0.6, 1.2), rest=(1.0, 2.5))


def _targets(
    t: Float[np.ndarray, " sample"],
    rng: np.random.Generator,
    travel: tuple[float, float],
    rest: tuple[float, float],
) -> Float[np.ndarray, " sample"]:
    wave, start, here = np.empty_like(t), t[0] - rng.uniform(0, 1.5), float(rng.uniform(-1, 1))
    while start < t[-1]:
        there, duration = float(rng.uniform(-1, 1)), rng.uniform(*travel)
        s = np.clip((t - start) / duration, 0, 1)
        wave = np.where(t >= start, here + (there - here) * s**3 * (10 - 15 * s + 6 * s * s), wave)
        start, here = start + duration + rng.uniform(*rest), there
    return wave


def _jumps(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Steps of the command to random targets at most half the amplitude away."""
    times = np.cumsum(rng.uniform(0.35, 1.3, int((t[-1] - t[0]) / 0.35) + 4)) + t[0] - 2.0
    targets = [0.0]
    for _ in times:
        step = rng.uniform(0.12, 0.5) * rng.choice([-1.0, 1.0])
        step = -step if abs(targets[-1] + step) > 1 else step
        targets.append(float(targets[-1] + step))
    return np.array(targets)[np.searchsorted(times, t, side="right")]


def _chirp(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """A sine whose frequency rises and falls, its amplitude falling with it."""
    low, high = rng.uniform(0.1, 0.2), rng.uniform(1.2, 2.2)
    period, phase = rng.uniform(6, 10), rng.uniform(0, 1)
    sweep = 0.5 - 0.5 * np.cos(2 * np.pi * (t / period + phase))
    f = low * (high / low) ** sweep
    angle = 2 * np.pi * np.cumsum(f) * np.median(np.diff(t)) + rng.uniform(0, 6)
    return np.asarray(np.sin(angle) / (0.7 + f))


def _creep(
    t: Float[np.ndarray, " sample"], rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Slow, on one side of the middle: what a machine does when nobody asks it for more."""
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return np.asarray(0.5 + 0.3 * np.sin(1.1 * t + a) + 0.15 * np.sin(2.3 * t + b))


def _mixture(
    t: Float[np.ndarray, " sample"],
    middle: Float[np.ndarray, " joint"],
    amplitude: Float[np.ndarray, " joint"],
    tempo: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"]:
    """Three other motions one after the other, joined by smooth half-second bridges."""
    kinds = rng.permutation([kind for kind in MOTIONS if kind != "mixture"])[:3]
    edges = np.linspace(t[0], t[-1], 4)
    out = reference(str(kinds[0]), t, middle, amplitude, tempo, rng)
    for kind, edge in zip(kinds[1:], edges[1:-1], strict=True):
        after = reference(str(kind), t, middle, amplitude, tempo, rng)
        a, b = np.searchsorted(t, [edge - 0.25, edge + 0.25])
        flat = np.zeros_like(out[[a, b]])
        bridge = CubicHermiteSpline(t[[a, b]], np.stack([out[a], after[b]]), flat)
        out = np.concatenate([out[:a], bridge(t[a:b]), after[b:]])
    return out


SHAPES: dict[str, Shape] = {
    "multisine": _multisine,
    "triangle": _triangle,
    "moves": _moves,
    "jumps": _jumps,
    "chirp": _chirp,
    "holds": _holds,
    "creep": _creep,
}
