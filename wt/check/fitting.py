"""Least squares in which missing physics may adapt, each with the sign that it must have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear, nnls

_SLOW = 0.03  # of the usual speed: where friction changes its sign


@dataclass(frozen=True)
class Fit:
    """How a row's command is explained.

    Attributes:
        left: mean square that is not.
        sent: variance of the command.
        forced: variance of what it adds to the position that the drive holds.
        gain: of the model's, over the drive's.
        late: time that the drive takes to follow it [s].
    """

    left: float
    sent: float
    forced: float
    gain: float
    late: float


def soft_sign(speed: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
    """Direction of a motion, −1…1, that turns over softly: dry friction is along it."""
    return np.asarray(np.tanh(speed / (_SLOW * max(float(speed.std()), 1e-9))))


def without(
    signal: Float[np.ndarray, " row *axis"], columns: Float[np.ndarray, "row column"]
) -> Float[np.ndarray, " row *axis"]:
    """A signal less all that some columns explain of it."""
    ortho, _ = np.linalg.qr(columns)
    return np.asarray(signal - ortho @ (ortho.T @ signal))


def of_position(q: Float[np.ndarray, " row"]) -> Float[np.ndarray, "row column"]:
    """Forces that go with a joint's position: a spring, a weight."""
    return np.stack([q, np.cos(q), np.sin(q)], axis=1)


def adapted(
    columns: Float[np.ndarray, "row column"],
    target: Float[np.ndarray, " row"],
    low: Float[np.ndarray, " column"],
    high: Float[np.ndarray, " column"],
    free: Float[np.ndarray, "row _"] | None = None,
) -> tuple[float, Float[np.ndarray, " column"]]:
    """Mean square that the columns leave of the target, and how much of each is taken.

    A constant is free, and what else is.
    """
    x = columns - columns.mean(axis=0)
    y = target - target.mean()
    if free is not None:
        free = free - free.mean(axis=0)
        x, y = without(x, free), without(y, free)
    y = y - x @ low
    scale = np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-12)
    r, z = _triangle(x / scale, y)
    best, _ = nnls(r, z)
    if (best / scale > high - low).any():
        best = lsq_linear(r, z, (np.zeros(len(high)), (high - low) * scale), method="bvls").x
    return float(np.mean((y - (x / scale) @ best) ** 2)), low + best / scale


def _triangle(
    x: Float[np.ndarray, "row column"], y: Float[np.ndarray, " row"]
) -> tuple[Float[np.ndarray, "column column"], Float[np.ndarray, " column"]]:
    """The same least squares on as many rows as there are columns."""
    ortho, r = np.linalg.qr(x)
    return r, ortho.T @ y
