"""Motions that excite a joint, as offsets from a centre: each starts and ends at zero, at rest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

_EDGE = 0.1  # share of a multisine in which it fades in, and out


def move(start: float, end: float, n: int) -> Float[np.ndarray, " sample"]:
    """Minimum-jerk move from one position to another.

    Source: T. Flash and N. Hogan, The coordination of arm movements, J. Neuroscience 5(7), 1985.
    """
    s = np.linspace(0.0, 1.0, n)
    return start + (end - start) * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)


def reversals(n: int, dt: float, speed: float, amplitude: float) -> Float[np.ndarray, " sample"]:
    """Triangle of constant speed with at least two whole periods.

    Args:
        n: samples.
        dt: their distance [s].
        speed: of the joint between the reversals [rad/s].
        amplitude: greatest distance from the centre [rad].
    """
    seconds = n * dt
    periods = max(2, int(np.ceil(speed * seconds / (4.0 * amplitude))))
    phase = np.arange(n) / n * periods % 1.0
    triangle = np.where(
        phase < 0.25, phase, np.where(phase < 0.75, 0.5 - phase, phase - 1.0)
    )  # from -1/4 to 1/4
    return np.asarray(triangle * speed * seconds / periods)


def steps(
    n: int, dt: float, speed: float, amplitude: float, rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Jumps between random levels at intervals of 0.4 to 1.2 s, as fast as ``speed``."""
    amplitude = min(amplitude, 0.9 * speed)  # rad: from where one second brings it back
    levels = np.zeros(n)
    at, side = 0, 1.0
    while at < n - round(1.0 / dt):  # the last second is for the way back
        until = at + round(float(rng.uniform(0.4, 1.2)) / dt)
        levels[at:until] = side * rng.uniform(0.3, 1.0) * amplitude
        at, side = until, -side
    levels[max(0, n - round(1.0 / dt)) :] = 0.0
    return _slewed(levels, speed * dt)


def holds(
    n: int, dt: float, speed: float, amplitude: float, count: int = 5
) -> Float[np.ndarray, " sample"]:
    """Rests at angles from one end to the other: every load, with nothing moving."""
    each = n // (count + 1)
    # a minimum-jerk move is 1.875 times as fast as the mean of its speed; at least 40 % is rest
    amplitude = min(amplitude, 0.6 * each * dt * speed / 1.875)
    angles = np.concatenate([np.linspace(-1.0, 1.0, count) * amplitude, [0.0]])
    parts, before = [], 0.0
    for angle in angles:
        length = max(2, int(np.ceil(1.875 * abs(angle - before) / (speed * dt))))
        parts += [move(before, angle, length), np.full(each - length, angle)]
        before = float(angle)
    return np.concatenate([*parts, np.zeros(n - each * len(angles))])


def multisine(
    n: int, dt: float, speed: float, amplitude: float, band: tuple[float, float], turn: int = 0
) -> Float[np.ndarray, " sample"]:
    """Sum of sines of equal speed with Schroeder's phases: much power, low peaks.

    Source: M. R. Schroeder, Synthesis of low-peak-factor signals, IEEE Trans. Information Theory
    16(1), 1970.

    Args:
        n: samples.
        dt: their distance [s].
        speed: greatest speed [rad/s].
        amplitude: greatest distance from the centre [rad].
        band: lowest and highest frequency [Hz].
        turn: joints that move together take different turns, and so different frequencies.
    """
    seconds = n * dt
    wanted = np.geomspace(max(band[0], 2.0 / seconds), band[1], 12)
    # whole periods in the time there is; a shift for every turn keeps joints apart
    lines = np.unique(np.round(wanted * seconds).astype(int)) + turn
    k = np.arange(len(lines))
    phases = -np.pi * k * (k + 1) / len(lines)
    t = np.arange(n) * dt
    waves = np.sin(2.0 * np.pi * lines[:, None] / seconds * t + phases[:, None]) / lines[:, None]
    fade = np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) / (_EDGE * n), 0.0, 1.0)
    signal = waves.sum(axis=0) * np.sin(0.5 * np.pi * fade) ** 2
    peak, fastest = np.abs(signal).max(), np.abs(np.gradient(signal, dt)).max()
    return np.asarray(signal * min(amplitude / peak, speed / fastest))


def _slewed(levels: Float[np.ndarray, " sample"], rate: float) -> Float[np.ndarray, " sample"]:
    """Follow levels with at most ``rate`` per sample."""
    followed = np.empty_like(levels)
    now = 0.0
    for i, level in enumerate(levels):
        now += float(np.clip(level - now, -rate, rate))
        followed[i] = now
    return followed
