"""Gaits of a quadruped's feet: a trot on two feet at a time, a walk on three.

Feet move in the trunk's frame, backwards while they stand and forwards through the air.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.prove.motions import SHAPES

_TROT_PHASE = np.array([0.0, 0.5, 0.5, 0.0])
_WALK_PHASE = np.array([0.75, 0.25, 0.0, 0.5])
_PACE = (0.3, 0.12, 0.5)
"""Of a trot: forward, sideways [m/s], turning [rad/s]; a walk goes at a third of that."""


def trot(
    t: Float[np.ndarray, " sample"],
    stand: Float[np.ndarray, "foot 3"],
    grown: Float[np.ndarray, "sample 1"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample foot 3"]:
    """Feet of a trot, relative to where they stand [m].

    Args:
        t: times [s].
        stand: feet in the trunk's frame [m].
        grown: share of full size.
        rng: decides speed, direction and pace.
    """
    period, duty = rng.uniform(0.42, 0.55), rng.uniform(0.55, 0.62)
    phase = (t[:, None] / period + _TROT_PHASE) % 1.0
    way = _way(t, stand, grown, np.array(_PACE), rng) * (duty * period)
    return _feet(phase, duty, way, rng.uniform(0.045, 0.06) * grown)


def walk(
    t: Float[np.ndarray, " sample"],
    stand: Float[np.ndarray, "foot 3"],
    grown: Float[np.ndarray, "sample 1"],
    rng: np.random.Generator,
    on_the_spot: bool,
) -> Float[np.ndarray, "sample foot 3"]:
    """Feet of a walk, one in the air at a time, relative to where they stand [m].

    They are in the air so briefly that the trunk hardly tips: leaning it over three feet first,
    with drives as soft as these, swings it more than that.

    Args:
        t: times [s].
        stand: feet in the trunk's frame [m].
        grown: share of full size.
        rng: decides speed, direction and pace.
        on_the_spot: feet reach out and come back to where they stood.
    """
    period, duty = rng.uniform(0.45, 0.7), 0.75
    phase = (t[:, None] / period + _WALK_PHASE) % 1.0
    pace = np.zeros(3) if on_the_spot else 0.35 * np.array(_PACE)
    way = _way(t, stand, grown, pace, rng) * (duty * period)
    feet = _feet(phase, duty, way, rng.uniform(0.035, 0.055) * grown)
    if on_the_spot:
        flight = _flight(phase, duty)
        reach = np.stack([SHAPES["multisine"](2 * t, rng) for _ in range(8)], axis=1)
        aloft = np.sin(np.pi * flight) ** 2 * (flight > 0)
        feet[:, :, :2] += 0.05 * (grown * aloft)[:, :, None] * reach.reshape(-1, 4, 2)
    return feet


def _way(
    t: Float[np.ndarray, " sample"],
    stand: Float[np.ndarray, "foot 3"],
    grown: Float[np.ndarray, "sample 1"],
    pace: Float[np.ndarray, " 3"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample foot 3"]:
    """Velocity of each foot over the ground, with the sign of the trunk's motion [m/s]."""
    vx, vy, turn = (size * SHAPES["holds"](t, rng) for size in pace)
    velocity = np.zeros((len(t), 4, 3))
    velocity[:, :, 0] = vx[:, None] - turn[:, None] * stand[:, 1]
    velocity[:, :, 1] = vy[:, None] + turn[:, None] * stand[:, 0]
    return velocity * grown[:, :, None]


def _flight(
    phase: Float[np.ndarray, "sample foot"], duty: float
) -> Float[np.ndarray, "sample foot"]:
    """Share of the way through the air, 0 while the foot stands."""
    return np.clip((phase - duty) / (1.0 - duty), 0.0, 1.0)


def _feet(
    phase: Float[np.ndarray, "sample foot"],
    duty: float,
    way: Float[np.ndarray, "sample foot 3"],
    lift: Float[np.ndarray, "sample 1"],
) -> Float[np.ndarray, "sample foot 3"]:
    """Half the way in front to half the way behind while standing, and back through the air."""
    flight = _flight(phase, duty)
    # a cycloid, so that feet land and leave at rest
    back = flight - np.sin(2 * np.pi * flight) / (2 * np.pi)
    along = np.where(flight > 0, back - 0.5, 0.5 - np.minimum(phase / duty, 1.0))
    feet = along[:, :, None] * way
    feet[:, :, 2] += lift * 0.5 * (1.0 - np.cos(2 * np.pi * flight))
    return np.asarray(feet)
