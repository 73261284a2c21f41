"""A force that acts on a body now and then, such as a push or a snagging cable."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.types import Location

if TYPE_CHECKING:
    from wt.physics.replay import Inputs

Array = np.ndarray

_THRESHOLDS = (4.0, 8.0)  # robust deviations above the usual
_SHORTEST, _GAP, _SMOOTH = 0.04, 0.1, 0.06  # s


@register
class BodyForceIntermittent(Effect):
    """A force constant in the world's frame on the centre of mass, inside windows of time.

    The windows are no part of ``theta``: they stand in the signature's shape, flattened
    (recording, start, end, …), and :meth:`shaped` returns the effect that replays them.
    """

    id = "body.force_intermittent"
    kind = "body"
    parameters = (Parameter("force", "N", -1e4, 1e4, 1e-2, ("x", "y", "z"), neutral=0.0),)
    reference = "S. Haddadin, A. De Luca and A. Albu-Schäffer, Robot collisions, IEEE T-RO 33, 2017"
    native = False
    reads_residual = True
    signed = (0, 0, 0)

    def __init__(self, windows: Shape = ()) -> None:
        """Bind windows, flattened (recording, start [s], end [s], …)."""
        self.windows = windows

    def shaped(self, shape: Shape) -> BodyForceIntermittent:
        """The effect bound to windows."""
        bound = copy.copy(self)
        bound.windows = tuple(shape)
        return bound

    def elsewhere(self, motion: Motion, at: Location, theta: Array) -> BodyForceIntermittent:
        """The same force, at the times at which these recordings show it."""
        return self.shaped(_acting(motion, at.name, theta))

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Times at which the residual, as a force on the body, stands out."""
        if self.windows:
            return [self.windows]
        found = set()
        for threshold in _THRESHOLDS:
            windows = _proposed(motion, at.name, threshold)
            if windows:
                force = _mean_force(motion, at.name, self.columns(motion, at, windows))
                found.add(_acting(motion, at.name, force))
        return sorted(windows for windows in found if windows)

    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """Generalised force per newton along x, y and z, inside the windows."""
        inside = np.zeros(len(motion))
        for s in motion.segments:
            for recording, start, end in _triples(shape):
                if int(recording) == s.recording:
                    covered = _covered(motion.t[s.rows] - 0.5 * s.dt, s.dt, start, end)
                    inside[s.rows] = np.maximum(inside[s.rows], covered)
        return np.swapaxes(motion.point(at.name).jacobian, 1, 2) * inside[:, None, None]

    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """The force."""
        return coefficients

    def drive(self, inputs: Inputs, scene: Scene, at: Location, theta: Array) -> None:
        """Push in the windows of this recording."""
        body = scene.model.body(at.name).id
        inside = np.zeros(len(inputs.t))
        for recording, start, end in _triples(self.windows):
            if int(recording) == inputs.recording:
                inside = np.maximum(inside, _covered(inputs.t, inputs.h, start, end))
        force = inputs.force.setdefault(body, np.zeros((len(inputs.t), 3)))
        force += inside[:, None] * theta

    def observed(self) -> Mapping[str, tuple[str, tuple[float, ...]]]:
        """The windows' starts and ends, one after another."""
        return {"windows": ("s", tuple(x for _, *ends in _triples(self.windows) for x in ends))}

    def statement(self, at: Location, theta: Array) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z = theta
        spans = [f"{start:.2f}–{end:.2f} s" for _, start, end in _triples(self.windows)]
        more = f" and {len(spans) - 4} more" if len(spans) > 4 else ""
        return (
            f"A force of {x:.3g}, {y:.3g}, {z:.3g} N (world x, y, z) acts on {at} at "
            f"{', '.join(spans[:4])}{more}."
        )

    def separation(self, at: Location) -> str:
        """See :meth:`Effect.separation`."""
        return f"the same motion again, with nothing and nobody near {at.name}"


def _triples(windows: Shape) -> list[tuple[float, float, float]]:
    return list(zip(windows[::3], windows[1::3], windows[2::3], strict=True))


def _covered(t: Array, h: float, start: float, end: float) -> Array:
    """Share of the interval [t, t + h] that lies between start and end, (n,)."""
    return np.asarray(np.clip((np.minimum(t + h, end) - np.maximum(t, start)) / h, 0.0, 1.0))


def _mean_force(motion: Motion, body: str, columns: Array) -> Array:
    """The force on a body that its columns (T, nv, 3) explain the residual best with, (3,) [N]."""
    scale = np.std(motion.unexplained, axis=0) + 1e-12
    design = (motion.touching.free(columns) / scale[:, None]).reshape(-1, 3)
    found, *_ = np.linalg.lstsq(design, (motion.unexplained / scale).reshape(-1), rcond=1e-6)
    return np.asarray(found)


def _acting(motion: Motion, body: str, force: Array) -> Shape:
    """Windows in which a known force shows: more than half of it, by a matched filter."""
    weight = 1.0 / (np.var(motion.unexplained, axis=0) + 1e-24)
    expected = _on(motion, body) @ force  # (T, nv)
    size = expected**2 @ weight
    seen = (motion.unexplained * expected) @ weight / (size + 0.05 * size.mean() + 1e-12)
    return _windows(motion, seen, lambda _: 0.5)


def _on(motion: Motion, body: str) -> Array:
    """Free part of a unit force on a body along x, y and z, (T, nv, 3)."""
    return motion.touching.free(motion.point(body).jacobian.swapaxes(1, 2))


def _proposed(motion: Motion, body: str, threshold: float) -> Shape:
    """Windows in which the residual's part that a force on the body can make stands out."""
    scale = np.std(motion.unexplained, axis=0) + 1e-12
    scaled = _on(motion, body) / scale[:, None]
    projected = scaled @ (
        np.linalg.pinv(scaled, rcond=1e-3) @ (motion.unexplained / scale)[..., None]
    )
    size = np.linalg.norm(projected[..., 0], axis=1)

    def unusual(smooth: Array) -> float:
        usual = float(np.median(smooth))
        return usual + threshold * (1.4826 * float(np.median(np.abs(smooth - usual))) + 1e-12)

    return _windows(motion, size, unusual)


def _windows(motion: Motion, signal: Array, level: Callable[[Array], float]) -> Shape:
    """Spans in which a signal (T,), smoothed, exceeds a level of it, flattened."""
    windows: list[float] = []
    for s in motion.segments:
        width = max(1, round(_SMOOTH / s.dt))
        smooth = np.convolve(signal[s.rows], np.full(width, 1.0 / width), mode="same")
        for start, end in _spans(smooth > level(smooth), round(_GAP / s.dt)):
            t = motion.t[s.rows]
            if t[end] - t[start] >= _SHORTEST:
                windows += [float(s.recording), float(t[start]), float(t[end])]
    return tuple(windows)


def _spans(above: Array, gap: int) -> list[tuple[int, int]]:
    """First and last index of each run, runs closer than a gap merged."""
    rows = np.flatnonzero(above)
    if not len(rows):
        return []
    breaks = np.flatnonzero(np.diff(rows) > max(gap, 1))
    first, last = np.append(0, breaks + 1), np.append(breaks, len(rows) - 1)
    return [(int(rows[a]), int(rows[b])) for a, b in zip(first, last, strict=True)]
