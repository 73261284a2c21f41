"""A velocity column against the slope of a position column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from wt.check.signals import has, linear
from wt.data.recording import coordinate
from wt.types import Recording

_WINDOW_S = 0.03
_CLEAR = 4.0  # times its own noise that a velocity has to be, to be compared
_ABSENT = 0.5  # of what it should be, that is left of it where it is drowned in noise
_ALIKE = 0.9
_LATEST_S, _LATEST_SAMPLES = 0.5, 60
"""How far behind a slope, or ahead of it, a velocity is looked for: the longer of both."""


@dataclass(frozen=True)
class Relation:
    """How a velocity goes with the slope of a position.

    Attributes:
        correlation: of both, smoothed, the velocity brought forward by ``late``.
        factor: velocity over slope, with its sign.
        late: time that the velocity comes behind the slope [s].
    """

    correlation: float
    factor: float
    late: float


def related(recording: Recording, velocity: str, position: str) -> Relation | None:
    """How a velocity goes with a position; None where either is missing, or hardly moves.

    None too for the turning of a free joint: its velocity is no slope of its quaternion.

    Args:
        recording: both are columns of it.
        velocity: name of the joint whose ``qvel`` is taken.
        position: name of the joint whose ``qpos`` is taken.
    """
    if (coordinate(velocity) or 0) > 2:
        return None
    pair = _smooth(recording, f"qvel/{velocity}", f"qpos/{position}")
    if pair is None:
        return None
    v, slope, dt = pair
    late = _late(v, slope, max(round(_LATEST_S / dt), _LATEST_SAMPLES))
    if late:
        ends = (
            slice(max(late, 0), len(v) + min(late, 0)),
            slice(max(-late, 0), len(v) - max(late, 0)),
        )
        v, slope = v[ends[0]], slope[ends[1]]
    r = float(np.corrcoef(v, slope)[0, 1])
    return Relation(r, float(np.sign(r) * v.std() / slope.std()), late * dt)


def belongs(recording: Recording, joint: str) -> bool:
    """Tell whether a joint's velocity is the slope of its position, as recorded."""
    relation = related(recording, joint, joint)
    return relation is not None and relation.correlation > _ALIKE and (0.7 < relation.factor < 1.4)


def _smooth(
    recording: Recording, velocity: str, position: str
) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, " row"], float] | None:
    columns, t = recording.columns, recording.t
    if not has(columns.get(velocity)) or not has(columns.get(position)):
        return None
    dt = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1], dt)
    x, near = linear(grid, t, columns[position])
    v, near_v = linear(grid, t, columns[velocity])
    sigma = max(_WINDOW_S / dt, 1.5)
    known = gaussian_filter1d((near & near_v).astype(float), sigma, mode="constant") > 0.999
    if known.sum() < 40:
        return None
    slope = gaussian_filter1d(x, sigma, order=1) / dt
    smooth = gaussian_filter1d(v, sigma)
    # noise that is left after the window, of white noise as large as what the window took away
    left = np.sqrt(1.0 / (2.0 * np.sqrt(np.pi) * sigma))
    noise = float((v - smooth)[known].std()) * left
    noise_x = float((x - gaussian_filter1d(x, sigma))[known].std()) * left / (sigma * dt)
    size, due = float(smooth[known].std()), float(slope[known].std())
    if due < max(_CLEAR * noise_x, 1e-9) or size < 1e-9:
        return None
    # noise hides a velocity, but none that would stand out of it
    if size < _CLEAR * noise and due < max(size / _ABSENT, _CLEAR * noise):
        return None
    return smooth[known], slope[known], dt


def _late(v: Float[np.ndarray, " row"], slope: Float[np.ndarray, " row"], most: int) -> int:
    """Samples by which a velocity comes behind a slope, by their best correlation of any sign."""
    most = min(most, len(v) // 4)
    # ∑ slope(k) · v(k + lag), for all lags at once
    size = 2 ** int(np.ceil(np.log2(2 * len(v))))
    spectrum = np.conj(np.fft.rfft(slope - slope.mean(), size)) * np.fft.rfft(v - v.mean(), size)
    product = np.fft.irfft(spectrum, size)
    lags = np.arange(-most, most + 1)
    return int(lags[int(np.argmax(np.abs(product[lags])))])
