"""A model that explodes under the recording's commands, or whose time step is too coarse for them.

The recording is replayed as a user would, by plain steps of the model's own length under commands
that are held, and again by steps of an eighth. A coarse step errs by what tells the two apart, and
nothing of it is fitted: the step is to blame if the fine replay leaves a tenth of the squared error
of the coarse one. Physics that is missing is missing from both. A step that is finer than that of
the simulator that was recorded looks like commands that come half a step late: a delay's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.check.audit import Stage, Subject, register
from wt.check.audits.model import explodes, unstable
from wt.check.finding import AuditFinding
from wt.physics.scene import Amendment, Scene
from wt.types import Recording

_FINER = 8
_COARSE_S = 1e-3  # steps below are not suspected
_WINDOWS, _LONG_S = 12, 0.4  # short replays from recorded states, all over the recording
_AROUND_S, _AROUND = 0.02, 4  # time, and samples, on either side that tell a state
_MOST_S, _MOST_STEPS = 10.0, 20_000  # of the replay that may explode
_DECISIVE = 10.0  # mean square error of the coarse replays, over that of the fine ones
_MATERIAL = 2e-3  # of a joint's travel, that the step must err by
_EXPLAINED = 0.5  # of every command: in other units, or signs, they may well make a model explode


@register
class Replayed:
    """The model runs under the commands, by steps that are short enough."""

    kinds: ClassVar[tuple[str, ...]] = ("model_explodes", "model_timestep")
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one."""
        balance, recording = subject.balance, subject.recording
        if balance is None or recording is None or not balance.dynamic or not balance.rows:
            return
        scene = balance.scene
        if not _whole(scene, recording) or balance.unexplained().max() > _EXPLAINED:
            return
        if explodes(scene) is not None:
            return
        table = _Table(scene, recording)
        after = table.until_it_explodes()
        if after is not None:
            yield AuditFinding(
                "model_explodes",
                (),
                ("world",),
                f"Under the recording's commands the model becomes unstable after {after:.3g} s at "
                f"a time step of {1e3 * scene.given.opt.timestep:.3g} ms",
                'a smaller <option timestep="…"/>, softer gains, or bodies that do not overlap',
            )
        elif scene.given.opt.timestep > _COARSE_S:
            yield from _coarse(table)


def _whole(scene: Scene, recording: Recording) -> bool:
    """Tell whether every position and command was recorded."""
    m = scene.given
    names = [f"qpos/{j}" for j in scene.joints]
    names += [f"ctrl/{m.actuator(i).name}" for i in range(m.nu)]
    known = (recording.columns.get(n, np.nan) for n in names)
    return not scene.free and all(np.isfinite(column).any() for column in known)


def _coarse(table: _Table) -> Iterable[AuditFinding]:
    """The finding, where the fine replays err so much less."""
    h = float(table.model.opt.timestep)
    rows = list(table.windows())
    if not rows:
        return
    truth = np.concatenate([table.q[window] for window in rows])
    own, fine = (np.concatenate([table.replay(w, n) for w in rows]) for n in (1, _FINER))
    own, fine = own - truth, fine - truth
    size = np.ptp(table.q, axis=0)
    by, left, rest = (np.sqrt(np.mean(x**2, axis=0)) for x in (own - fine, own, fine))
    shown = by > _MATERIAL * size
    if not shown.any() or not np.isfinite(left + rest).all():
        return
    gain = (left[shown] / rest[shown]) ** 2
    if np.exp(np.log(gain).mean()) < _DECISIVE or gain.min() < 1.0:
        return
    worst = int(np.argmax(np.where(shown, by / size, 0.0)))
    yield AuditFinding(
        "model_timestep",
        (),
        ("world",),
        f"Replays by the model's time step of {1e3 * h:.3g} ms miss {table.names[worst]} by "
        f"{left[worst]:.2g} after {_LONG_S:g} s, and by {1e3 * h / _FINER:.3g} ms by "
        f"{rest[worst]:.2g}: the step is too coarse for what was recorded",
        f'<option timestep="{h / _FINER:.3g}"/>',
        0.9,
        model_change=_stepped(h / _FINER),
    )


def _stepped(h: float) -> Amendment:
    def change(spec: mujoco.MjSpec) -> None:
        spec.option.timestep = h

    return change


class _Table:
    """A recording as arrays, and plain replays of it.

    Attributes:
        model: the model as it is given.
        names: of its joints.
        t: sample times since the start, (K,) [s].
        q: positions, (K, nv).
        u: commands, (K, nu).
    """

    def __init__(self, scene: Scene, recording: Recording) -> None:
        self.model, self.names = scene.given, scene.joints
        self.t = recording.t - recording.t[0]
        columns = recording.columns
        self.q = np.stack([self._known(columns[f"qpos/{j}"]) for j in scene.joints], axis=1)
        drives = [self.model.actuator(i).name for i in range(self.model.nu)]
        held = [self._held(columns[f"ctrl/{n}"]) for n in drives]
        self.u = np.stack(held, axis=1) if held else np.zeros((len(self.t), 0))

    def until_it_explodes(self) -> float | None:
        """Time that the model runs from the first state before it explodes [s]; None if it does."""
        d = self._state(0)
        for k in self._steps(d, 0, min(_MOST_S, float(self.t[-1]))):
            if unstable(d):
                return float(d.time)
            if k >= _MOST_STEPS:
                break
        return None

    def windows(self) -> Iterator[Int[np.ndarray, " row"]]:
        """Samples of each short replay."""
        last = self.t[-1] - _LONG_S - _AROUND_S
        for start in np.linspace(min(_AROUND_S, last), last, _WINDOWS):
            rows = np.flatnonzero((self.t >= start) & (self.t <= start + _LONG_S))
            if len(rows) > 2 * _AROUND:
                yield rows

    def replay(self, rows: Int[np.ndarray, " row"], finer: int) -> Float[np.ndarray, "row dof"]:
        """Positions at the samples of a window, by so many steps for one of the model's."""
        d = self._state(int(rows[0]))
        times, path = [float(self.t[rows[0]])], [d.qpos.copy()]
        own = self.model.opt.timestep
        self.model.opt.timestep = own / finer
        try:
            for _ in self._steps(d, int(rows[0]), float(self.t[rows[-1]])):
                times.append(float(self.t[rows[0]]) + d.time)
                path.append(d.qpos.copy())
        finally:
            self.model.opt.timestep = own
        table = np.array(path)
        return np.stack([np.interp(self.t[rows], times, x) for x in table.T], axis=1)

    def _steps(self, d: mujoco.MjData, row: int, until: float) -> Iterator[int]:
        """Step until a time, under the command that is in force at the start of each step."""
        start, count = float(self.t[row]), 0
        while start + d.time < until:
            while row + 1 < len(self.t) and self.t[row + 1] <= start + d.time + 1e-9:
                row += 1
            d.ctrl[:] = self.u[row]
            mujoco.mj_step(self.model, d)
            count += 1
            yield count

    def _state(self, row: int) -> mujoco.MjData:
        """The model in the state of a sample, which a cubic through its neighbours tells."""
        d = mujoco.MjData(self.model)
        near = np.abs(self.t - self.t[row]) <= _AROUND_S
        near[max(row - _AROUND, 0) : row + _AROUND + 1] = True
        *_, v, q = np.polyfit(self.t[near] - self.t[row], self.q[near], 3)
        d.qpos[:], d.qvel[:] = q, v
        if self.model.na:
            d.act[:] = self.u[row][self.model.actuator_actadr >= 0][: self.model.na]
        mujoco.mj_forward(self.model, d)
        return d

    def _known(self, x: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        ok = np.isfinite(x)
        return np.interp(self.t, self.t[ok], x[ok])

    def _held(self, x: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        """Each command until the next that is known; the first one before it."""
        last = np.maximum.accumulate(np.where(np.isfinite(x), np.arange(len(x)), -1))
        return np.asarray(x[np.where(last < 0, int(np.argmax(np.isfinite(x))), last)])
