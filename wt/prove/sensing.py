"""Recordings of a hidden world as a user makes them: encoders, clocks and noise.

Order: true position, sensor effects (delay, scale, offset), noise, encoder step. The servo inside
the robot uses the true position throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from wt.prove.base_sensing import BaseSensing
from wt.prove.hidden import Parameters
from wt.prove.rigs import Rig
from wt.prove.trajectory import HiddenTrajectory

SensorEffect = tuple[str, str, Parameters]
"""Effect id, joint (or ``all``), parameters."""


@dataclass(frozen=True)
class Sensing:
    """The sensors and clock of a robot.

    Attributes:
        rate: samples (and commands) per second [Hz].
        bits: encoder resolution: a turn is 2^bits steps.
        noise: Gaussian noise on positions, rms [rad].
        colour: correlation of successive noise samples, 0 for white.
        jitter: rms of the clock's error, as a fraction of the sampling interval.
        clock: ``stamps``: samples are even and their time stamps err; ``loop``: the loop runs
            unevenly and the stamps are right.
        drops: fraction of samples that are missing.
        missing: ``rows``: the loop missed a turn, and the command was held; ``nan``: the
            measurement was lost, the command is known.
        qvel: ``none``, ``noisy`` (a velocity sensor) or ``filtered`` (the difference of measured
            positions, low-passed).
        qvel_noise: rms of the velocity sensor's noise [rad/s].
        gyro: whether ``sensor/encoder/0`` and ``sensor/gyro/0…2`` are recorded.
        base: sensors of the trunk of a robot on legs; None without one.
    """

    rate: float
    bits: int
    noise: float
    colour: float = 0.0
    jitter: float = 0.0
    clock: Literal["stamps", "loop"] = "stamps"
    drops: float = 0.0
    missing: Literal["rows", "nan"] = "rows"
    qvel: Literal["none", "noisy", "filtered"] = "noisy"
    qvel_noise: float = 0.01
    gyro: bool = False
    base: BaseSensing | None = None

    @property
    def encoder_step(self) -> float:
        """[rad]."""
        return 2.0 * math.pi / 2**self.bits

    @property
    def position_noise(self) -> float:
        """Rms of noise and quantization together [rad]."""
        return math.sqrt(self.noise**2 + self.encoder_step**2 / 12.0)


def sample_steps(
    sensing: Sensing, seconds: float, h: float, rng: np.random.Generator
) -> Int[np.ndarray, " sample"]:
    """Steps of the hidden world at which the loop samples and sends, increasing, from 0."""
    count = int(seconds * sensing.rate)
    interval = 1.0 / (sensing.rate * h)
    at = np.arange(count) * interval
    if sensing.clock == "loop":
        at += np.clip(rng.normal(0, sensing.jitter, count), -0.45, 0.45) * interval
    at[0] = 0.0
    keep = np.ones(count, dtype=bool)
    if sensing.missing == "rows":
        keep = rng.random(count) >= sensing.drops
        keep[[0, -1]] = True
    return np.maximum.accumulate(np.rint(at[keep]).astype(int))


def stamps(
    sensing: Sensing, steps: Int[np.ndarray, " sample"], h: float, rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Time stamps of samples [s], increasing."""
    t = steps * h
    if sensing.clock == "stamps" and sensing.jitter:
        error = np.clip(rng.normal(0, sensing.jitter, len(t)), -0.45, 0.45)
        t = t + error / sensing.rate
        t -= t[0]
    return np.asarray(t)


def measure(
    rig: Rig,
    sensing: Sensing,
    trace: HiddenTrajectory,
    steps: Int[np.ndarray, " sample"],
    effects: Sequence[SensorEffect],
    rng: np.random.Generator,
) -> tuple[dict[str, Float[np.ndarray, " sample"]], Float[np.ndarray, "sample joint"]]:
    """The measured columns of one recording, and their error without hidden effects.

    Args:
        rig: the robot.
        sensing: its sensors and clock.
        trace: its trajectory.
        steps: steps of the samples.
        effects: hidden sensor effects.
        rng: decides the noise.

    Returns:
        Columns by name, and noise with quantization [rad].
    """
    q, v = _transform(rig, trace, steps, effects)
    noise = _noise(sensing, q.shape, rng)
    step = np.full(len(rig.links), sensing.encoder_step)
    for effect, place, parameters in effects:
        if effect == "sensor.quantization":
            step[rig.joints.index(place)] = float(parameters["step"])  # type: ignore[arg-type]
    measured = np.round((q + noise) / step) * step
    lost = np.zeros(len(q), dtype=bool)
    if sensing.missing == "nan":
        lost = rng.random(len(q)) < sensing.drops
        lost[[0, -1]] = False
    driven = [i for i, link in enumerate(rig.links) if link.driven]
    columns = {f"ctrl/{a}": trace.u[:, i] for i, a in zip(driven, rig.actuators, strict=True)}
    speed = _velocity(sensing, measured, v, steps * trace.h, rng)
    for i, joint in enumerate(rig.joints):
        columns[f"qpos/{joint}"] = np.where(lost, np.nan, measured[:, i])
        if speed is not None:
            columns[f"qvel/{joint}"] = np.where(lost, np.nan, speed[:, i])
    if sensing.gyro:
        columns["sensor/encoder/0"] = measured[:, 0]
        gyro = trace.sensors[:, 1:] + rng.normal(0, 0.004, (len(q), 3))
        columns |= {f"sensor/gyro/{i}": gyro[:, i] for i in range(3)}
    return columns, measured - q


def _transform(
    rig: Rig,
    trace: HiddenTrajectory,
    steps: Int[np.ndarray, " sample"],
    effects: Sequence[SensorEffect],
) -> tuple[Float[np.ndarray, "sample joint"], Float[np.ndarray, "sample joint"]]:
    q, v = trace.q.copy(), trace.v.copy()
    for effect, place, parameters in effects:
        which = range(len(rig.links)) if place == "all" else [rig.joints.index(place)]
        value = {k: float(p) for k, p in parameters.items()}  # type: ignore[arg-type]
        for i in which:
            if effect == "sensor.offset":
                q[:, i] += value["offset"]
            elif effect == "sensor.scale":
                q[:, i] *= value["factor"]
                v[:, i] *= value["factor"]
            elif effect == "sensor.delay":
                late = steps - value["delay"] / trace.h
                fine = np.arange(len(trace.fine_q))
                q[:, i] = np.interp(late, fine, trace.fine_q[:, i])
                v[:, i] = np.interp(late, fine, trace.fine_v[:, i])
    return q, v


def _noise(
    sensing: Sensing, shape: tuple[int, int], rng: np.random.Generator
) -> Float[np.ndarray, "sample joint"]:
    white = rng.normal(0, sensing.noise, shape)
    if not sensing.colour:
        return np.asarray(white)
    out = white.copy()
    # AR(1) of unchanged variance
    fresh = math.sqrt(1 - sensing.colour**2)
    for k in range(1, len(out)):
        out[k] = sensing.colour * out[k - 1] + fresh * white[k]
    return np.asarray(out)


def _velocity(
    sensing: Sensing,
    measured: Float[np.ndarray, "sample joint"],
    v: Float[np.ndarray, "sample joint"],
    t: Float[np.ndarray, " sample"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"] | None:
    if sensing.qvel == "none":
        return None
    if sensing.qvel == "noisy":
        return np.asarray(v + rng.normal(0, sensing.qvel_noise, v.shape))
    # causal first-order low-pass at 15 Hz of the backward difference, as many drives do
    out = np.zeros_like(v)
    dt = np.diff(t)
    for k in range(1, len(t)):
        share = 1.0 - math.exp(-2 * math.pi * 15.0 * dt[k - 1])
        out[k] = out[k - 1] + share * ((measured[k] - measured[k - 1]) / dt[k - 1] - out[k - 1])
    out[0] = out[1]
    return out
