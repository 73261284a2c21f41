"""The motion of a recording, smooth enough for inverse dynamics, with commands as smooth.

Positions, their derivatives and the commands pass the same Gaussian window, so that whatever is
linear between them stays true, noise averages out, and nothing has to be fitted. Velocities that
were recorded are not used: they may be what is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from wt.physics.motion import Motion, Segment
from wt.physics.scene import Scene
from wt.types import Recording

WINDOW_S, WINDOW_SAMPLES = 0.025, 1.5
"""Deviation of the window, whichever is longer: a derivative needs some samples."""
GAP_S = 0.15
"""What happened in a longer gap is not known."""
_ROWS = 240
_STEPS = 8  # values that a column has at least: an end stop and a switch are no steps
_EVEN = 0.01  # of a step, by which a value may miss it
_MOST = 60_000  # grid points that are looked at


@dataclass(frozen=True, eq=False)
class Signals:
    """Smooth channels on an even grid.

    Attributes:
        q: positions of the scene's degrees of freedom; zero where not recorded.
        v: their slopes.
        a: their second derivatives.
        u: commands of the actuators, those in force around each grid point.
        du: their slopes.
        measured: degrees of freedom whose position was recorded.
        commanded: actuators whose command was recorded.
        dt: interval of the grid [s].
    """

    q: Float[np.ndarray, "row dof"]
    v: Float[np.ndarray, "row dof"]
    a: Float[np.ndarray, "row dof"]
    u: Float[np.ndarray, "row actuator"]
    du: Float[np.ndarray, "row actuator"]
    measured: Bool[np.ndarray, " dof"]
    commanded: Bool[np.ndarray, " actuator"]
    dt: float

    def motion(self, scene: Scene) -> Motion:
        """The same as the motion of a scene."""
        n = len(self.q)
        whole = (Segment(slice(0, n), 0, self.dt),)
        return Motion(scene, whole, self.dt * np.arange(n), self.q, self.v, self.a, self.u)

    @classmethod
    def of(cls, scene: Scene, recording: Recording) -> Signals | None:
        """Smooth a recording; None if it has no stretch that is long enough."""
        m, columns = scene.model, recording.columns
        joints = [f"qpos/{name}" for name in scene.joints]
        actuators = [f"ctrl/{m.actuator(i).name}" for i in range(m.nactuator)]
        t = recording.t
        dt = float(np.median(np.diff(t)))
        grid = np.arange(t[0], t[-1], dt)[:_MOST]
        if len(grid) < 40:
            return None
        sigma = max(WINDOW_S / dt, WINDOW_SAMPLES)
        known = np.ones(len(grid), dtype=bool)
        tables = [np.zeros((len(grid), len(joints))) for _ in range(3)]
        for i, name in enumerate(joints):
            if has(columns.get(name)):
                x, near = linear(grid, t, columns[name])
                seen = t[np.isfinite(columns[name])]
                known &= near & (grid >= seen[0]) & (grid <= seen[-1])
                for order, table in enumerate(tables):
                    table[:, i] = gaussian_filter1d(x, sigma, order=order) / dt**order
        u = np.zeros((len(grid), len(actuators)))
        du = np.zeros_like(u)
        for i, name in enumerate(actuators):
            if has(columns.get(name)):
                x = _held(grid, t, columns[name], dt)
                u[:, i] = gaussian_filter1d(x, sigma)
                du[:, i] = gaussian_filter1d(x, sigma, order=1) / dt
        rows = _rows(known, 4.0 * sigma)
        if len(rows) < 20:
            return None
        q, v, a = (table[rows] for table in tables)
        measured = [has(columns.get(name)) for name in joints]
        sent = [has(columns.get(name)) for name in actuators]
        return cls(q, v, a, u[rows], du[rows], np.array(measured, bool), np.array(sent, bool), dt)


def has(column: Float[np.ndarray, " sample"] | None) -> bool:
    """Tell whether a column is there, and has samples enough to be compared."""
    return column is not None and int(np.isfinite(column).sum()) >= 12


def step_of(column: Float[np.ndarray, " sample"]) -> float:
    """The step that all values of a column are whole numbers of apart; 0 if there is none."""
    values = np.unique(column[np.isfinite(column)])
    if len(values) < _STEPS:
        return 0.0
    step = float(np.diff(values).min())
    count = (values - values[0]) / step
    return step if (np.abs(count - np.round(count)) < _EVEN).all() else 0.0


def linear(
    grid: Float[np.ndarray, " row"],
    t: Float[np.ndarray, " sample"],
    x: Float[np.ndarray, " sample"],
) -> tuple[Float[np.ndarray, " row"], Bool[np.ndarray, " row"]]:
    """Values of a column between its samples, and where the two around are not far apart.

    Args:
        grid: times [s].
        t: times of the samples [s].
        x: the column; at least two samples are finite.
    """
    ok = np.isfinite(x)
    after = np.clip(np.searchsorted(t[ok], grid), 1, ok.sum() - 1)
    near = t[ok][after] - t[ok][after - 1] <= max(GAP_S, 3.0 * float(np.median(np.diff(t))))
    return np.interp(grid, t[ok], x[ok]), near


def _held(
    grid: Float[np.ndarray, " row"],
    t: Float[np.ndarray, " sample"],
    x: Float[np.ndarray, " sample"],
    dt: float,
) -> Float[np.ndarray, " row"]:
    """Mean command around each grid point; one is in force until the next was sent."""
    ok = np.isfinite(x)
    around = [grid - 0.25 * dt, grid + 0.25 * dt]
    last = [np.clip(np.searchsorted(t[ok], g, side="right") - 1, 0, None) for g in around]
    return np.asarray(0.5 * (x[ok][last[0]] + x[ok][last[1]]))


def _rows(known: Bool[np.ndarray, " row"], margin: float) -> Int[np.ndarray, " chosen"]:
    """Grid points far enough from ends and gaps, thinned evenly."""
    near = gaussian_filter1d((~known).astype(float), margin / 4.0, mode="constant", cval=1.0)
    rows = np.flatnonzero(near < 1e-3)
    return rows[:: max(len(rows) // _ROWS, 1)]
