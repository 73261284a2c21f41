"""A force that acts on a body now and then, such as a push or a snagging cable."""

from __future__ import annotations

import copy
import sys
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import FromRecordings, OnInputs, Shown
from wt.physics.motion import Motion, Segment
from wt.physics.replay import Inputs
from wt.physics.scene import Scene
from wt.physics.script import Script, number, wrapped
from wt.physics.units import HINGE, Units
from wt.types import Location

_THRESHOLDS = (4.0, 8.0)  # robust deviations above the usual
_SHORTEST, _GAP = 0.04, 0.1  # s
_FILTERS_S, _CALM = (0.06, 0.12, 0.24), 0.25
_BURST_S, _BURSTS = 0.25, 2
"""Length [s] and number of the moments that stand out most as a force other than usual."""


@register
class BodyForceIntermittent(FromRecordings, OnInputs):
    """A force constant in the world's frame on the centre of mass, inside windows of time.

    The windows are no part of ``theta``: they stand in the signature's shape, flattened
    (recording, start, end, …), and :meth:`shaped` returns the effect that replays them.
    """

    id = "body.force_intermittent"
    kind = "body"
    parameters = (Parameter("force", "N", -1e8, 1e8, 1e-2, ("x", "y", "z"), neutral=0.0),)
    reference = "S. Haddadin, A. De Luca and A. Albu-Schäffer, Robot collisions, IEEE T-RO 33, 2017"
    native = False
    reads_residual = True
    read_off = sys.maxsize
    momentary = True
    signed = (0, 0, 0)
    plotted_over = "time"

    def __init__(self, windows: Shape = ()) -> None:
        """Bind windows, flattened (recording, start [s], end [s], …)."""
        self.windows = windows

    def shaped(self, shape: Shape) -> BodyForceIntermittent:
        """The effect bound to windows."""
        bound = copy.copy(self)
        bound.windows = tuple(shape)
        return bound

    def elsewhere(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> Shown:
        """The same force, at the times at which these recordings show it."""
        return self.shaped(_acting(motion, _on(motion, at.name), theta)), theta

    def beside(self, theta: Float[np.ndarray, " parameter"], elsewhere: Shown) -> Shown:
        """The same force, at the times of both."""
        effect, _ = elsewhere
        more = effect.windows if isinstance(effect, BodyForceIntermittent) else ()
        spans = dict.fromkeys([*_triples(self.windows), *_triples(more)])
        return self.shaped(tuple(x for span in spans for x in span)), theta

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Times at which the residual, as a force on the body, stands out.

        By its size; and since a push on a robot that feet hold may be smaller than what else is
        left, wherever it has again the direction that it has in its most telling moments.
        """
        if self.windows:
            return [self.windows]
        on = _on(motion, at.name)
        bursts = {_acting(motion, on, force) for force in _bursts(motion, on)}
        for threshold in _THRESHOLDS:
            windows = _proposed(motion, on, threshold)
            if windows:
                force = _mean_force(motion, self.columns(motion, at, windows))
                bursts.add(_acting(motion, on, force))
        return sorted(windows for windows in bursts if windows)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Generalised force per newton along x, y and z, inside the windows."""
        inside = np.zeros(len(motion))
        for s in motion.segments:
            for recording, start, end in _triples(shape):
                if int(recording) == s.recording:
                    covered = _covered(motion.t[s.rows] - 0.5 * s.dt, s.dt, start, end)
                    inside[s.rows] = np.maximum(inside[s.rows], covered)
        return np.swapaxes(motion.point(at.name).jacobian, 1, 2) * inside[:, None, None]

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The force."""
        return coefficients

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
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

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Push in the windows of each recording."""
        windows: dict[int, list[str]] = {}
        for recording, start, end in _triples(self.windows):
            windows.setdefault(int(recording), []).append(f"({number(start)}, {number(end)})")
        spans = [f"    {i}: ({', '.join(each)},)," for i, each in windows.items()]
        x, y, z = map(number, theta)
        force = (
            "windows = {  # recording: start and end of each push [s]",
            *(line for span in spans for line in wrapped(span)),
            "}.get(self.recording, ())",
            "inside = np.zeros(len(t))",
            "for start, end in windows:",
            "    covered = (np.minimum(t + h, end) - np.maximum(t, start)) / h",
            "    inside = np.maximum(inside, np.clip(covered, 0.0, 1.0))",
            f'f += self._push("{at.name}", inside[:, None] * np.array([{x}, {y}, {z}]), qpos)',
        )
        return Script(force=force, helpers=("push",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z = theta
        spans = [f"{start:.2f}–{end:.2f} s" for _, start, end in _triples(self.windows)]
        more = f" and {len(spans) - 4} more" if len(spans) > 4 else ""
        return (
            f"A force of {x:.3g}, {y:.3g}, {z:.3g} N (world x, y, z) acts on {at} at "
            f"{', '.join(spans[:4])}{more}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"the same motion again, with nothing and nobody near {at.name}"


def _triples(windows: Shape) -> list[tuple[float, float, float]]:
    return list(zip(windows[::3], windows[1::3], windows[2::3], strict=True))


def _covered(
    t: Float[np.ndarray, " interval"], h: float, start: float, end: float
) -> Float[np.ndarray, " interval"]:
    """Share of the interval [t, t + h] that lies between start and end, (n,)."""
    return np.asarray(np.clip((np.minimum(t + h, end) - np.maximum(t, start)) / h, 0.0, 1.0))


def _mean_force(
    motion: Motion, columns: Float[np.ndarray, "sample dof 3"]
) -> Float[np.ndarray, " 3"]:
    """The force on a body that its columns (T, nv, 3) explain the residual best with, (3,) [N]."""
    scale = np.std(motion.unexplained, axis=0) + 1e-12
    design = (motion.touching.free(columns) / scale[:, None]).reshape(-1, 3)
    force, *_ = np.linalg.lstsq(design, (motion.unexplained / scale).reshape(-1), rcond=1e-6)
    return np.asarray(force)


def _usual(
    motion: Motion, segment: Segment
) -> tuple[Float[np.ndarray, " dof"], Float[np.ndarray, " sample"]]:
    """Usual size of a residual in a segment, and how much each of its moments counts."""
    calm = motion.calm[segment.rows]
    left = motion.unexplained[segment.rows]
    usual = np.median(np.abs(left[calm] if calm.any() else left), axis=0)
    return 1.4826 * usual + 1e-12, np.where(calm, 1.0, 0.01)


def _bursts(motion: Motion, on: Float[np.ndarray, "sample dof 3"]) -> list[Float[np.ndarray, " 3"]]:
    """Forces on a body in moments that differ most from the usual, (3,) each [N].

    Args:
        motion: the recordings.
        on: what unit forces on it do, (T, nv, 3).
    """
    forces, worths = [], []
    for s in motion.segments:
        left = motion.unexplained[s.rows]
        scale, weight = _usual(motion, s)
        design = on[s.rows] / scale[:, None]
        gram = weight[:, None, None] * (design.transpose(0, 2, 1) @ design)
        right = weight[:, None] * ((left / scale)[:, None] @ design)[:, 0]
        width = min(max(1, round(_BURST_S / s.dt)), len(left))
        gram, right = _sums(gram, width), _sums(right, width)
        ridge = 1e-6 * np.trace(gram, axis1=1, axis2=2) + 1e-12
        gram += ridge[:, None, None] * np.eye(3)
        force = np.linalg.solve(gram, right[:, :, None])[:, :, 0]
        other = force - np.median(force, axis=0)
        worth = np.einsum("ti,tij,tj->t", other, gram, other)
        for _ in range(_BURSTS):
            peak = int(np.argmax(worth))
            forces.append(other[peak])
            worths.append(float(worth[peak]))
            worth[max(0, peak - width) : peak + width] = 0.0
    order = np.argsort(worths)[::-1][:_BURSTS]
    return [forces[i] for i in order if worths[i] > 0.0]


def _sums(x: Float[np.ndarray, " sample *rest"], width: int) -> Float[np.ndarray, " sums *rest"]:
    """Sums over so many neighbours, (T − width + 1, …) of (T, …)."""
    total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)])
    return np.asarray(total[width:] - total[:-width])


def _acting(
    motion: Motion, on: Float[np.ndarray, "sample dof 3"], force: Float[np.ndarray, " 3"]
) -> Shape:
    """Windows in which a known force shows: more than half of it, by a matched filter.

    The filter is as long as it takes for what is left besides to stay below a quarter.
    """
    expected, windows = on @ force, list[float]()  # (T, nv)
    usual = 0.05 * np.mean(expected**2, axis=0)
    for s in motion.segments:
        left = motion.unexplained[s.rows]
        scale, weight = _usual(motion, s)
        known = expected[s.rows] / scale
        size = weight * ((known**2).sum(axis=1) + (usual / scale**2).sum())
        power = weight * (left / scale * known).sum(axis=1)
        for seconds in _FILTERS_S:
            seen = _smoothed(power, s.dt, seconds) / (_smoothed(size, s.dt, seconds) + 1e-12)
            if 1.4826 * np.median(np.abs(seen - np.median(seen))) < _CALM:
                break
        windows += _windows(motion, s, seen > 0.5)
    return tuple(windows)


def _on(motion: Motion, body: str) -> Float[np.ndarray, "sample dof 3"]:
    """Free part of a unit force on a body along x, y and z, (T, nv, 3)."""
    return motion.touching.free(motion.point(body).jacobian.swapaxes(1, 2))


def _proposed(motion: Motion, on: Float[np.ndarray, "sample dof 3"], threshold: float) -> Shape:
    """Windows in which the residual's part that a force on the body can make stands out."""
    scale = np.std(motion.unexplained, axis=0) + 1e-12
    scaled = on / scale[:, None]
    projected = scaled @ (
        np.linalg.pinv(scaled, rcond=1e-3) @ (motion.unexplained / scale)[..., None]
    )
    size = np.linalg.norm(projected[..., 0], axis=1)

    windows: list[float] = []
    for s in motion.segments:
        smooth = _smoothed(size[s.rows], s.dt, _FILTERS_S[0])
        usual = float(np.median(smooth))
        spread = 1.4826 * float(np.median(np.abs(smooth - usual))) + 1e-12
        windows += _windows(motion, s, smooth > usual + threshold * spread)
    return tuple(windows)


def _smoothed(
    signal: Float[np.ndarray, " sample"], dt: float, seconds: float
) -> Float[np.ndarray, " sample"]:
    """Running mean (T,)."""
    width = max(1, min(round(seconds / dt), len(signal)))
    return np.convolve(signal, np.full(width, 1.0 / width), mode="same")


def _windows(motion: Motion, segment: Segment, above: Bool[np.ndarray, " sample"]) -> list[float]:
    """Spans of a segment in which something is so, (T,) bool: recording, start, end, and so on."""
    windows, t = list[float](), motion.t[segment.rows]
    for start, end in _spans(above, round(_GAP / segment.dt)):
        if t[end] - t[start] >= _SHORTEST:
            windows += [float(segment.recording), float(t[start]), float(t[end])]
    return windows


def _spans(above: Bool[np.ndarray, " sample"], gap: int) -> list[tuple[int, int]]:
    """First and last index of each run, runs closer than a gap merged."""
    rows = np.flatnonzero(above)
    if not len(rows):
        return []
    breaks = np.flatnonzero(np.diff(rows) > max(gap, 1))
    first, last = np.append(0, breaks + 1), np.append(breaks, len(rows) - 1)
    return [(int(rows[a]), int(rows[b])) for a, b in zip(first, last, strict=True)]
