"""Further sensors, measured and in replays: gyros, accelerometers, encoders, actuator forces.

A replay gives the joints' path. MuJoCo computes the rest: position and velocity are set, the
acceleration is the path's own, and inverse dynamics fill ``sensordata``. Forces are read off the
patched model likewise, as long as all that acts is in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from wt.diagnose.evidence import SensorError
from wt.diagnose.recordings.samples import Part, stamps
from wt.diagnose.selection.holdout import Holdout
from wt.physics.acting import is_live
from wt.physics.hooks import OnOutputs
from wt.physics.planted import Hypothesis, Planted
from wt.physics.replay import Inputs, Outputs, Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

Array = np.ndarray


def sensed(
    parts: Sequence[Part], holdout: Holdout, hypothesis: Hypothesis, step: float
) -> tuple[tuple[SensorError, ...], tuple[str, ...]]:
    """Errors of replays of held-out recordings at every further sensor that was recorded.

    Args:
        parts: the held-out recordings.
        holdout: the same, ready to be replayed.
        hypothesis: the findings.
        step: physics step of the replays [s].

    Returns:
        (errors, names of sensors that cannot be compared).
    """
    scene = holdout.smoothed.motion.scene
    channels, left_out = _recorded(scene, parts, holdout.stretches)
    if not channels:
        return (), left_out
    before = predicted(scene, holdout, (), step, channels)
    after = (
        predicted(scene, holdout, holdout.here(hypothesis), step, channels)
        if hypothesis
        else before
    )
    found = []
    for channel in channels:
        errors = [_rms(x[channel.name], channel) for x in (before, after)]
        if errors[0] is not None:
            found.append(SensorError(channel.name, channel.unit, errors[0], errors[1]))
    return tuple(found), left_out


def _recorded(
    scene: Scene, parts: Sequence[Part], stretches: Sequence[Stretch]
) -> tuple[list[Channel], tuple[str, ...]]:
    """What was recorded besides the joints, at the samples of all stretches."""
    columns = {name for part in parts for name in part.recording.columns}
    found = [
        Channel(
            f"force/{d.name}",
            _units(scene, d.joint)["f"],
            _at_samples(parts, stretches, [f"force/{d.name}"]),
            "ACTUATORFRC",
            d.name,
        )
        for d in scene.drives
        if f"force/{d.name}" in columns
    ]
    left_out, m = [], scene.model
    for i in range(m.nsensor):
        name = m.sensor(i).name
        own = [f"sensor/{name}/{k}" for k in range(int(m.sensor_dim[i]))]
        if not columns & set(own):
            continue
        kind = mujoco.mjtSensor(int(m.sensor_type[i])).name.removeprefix("mjSENS_")
        unit = (MOTION | FORCES).get(kind)
        if unit is None:
            left_out.append(name)
            continue
        said = unit.format(**_units(scene, joint_of_sensor(m, i)))
        measured = _at_samples(parts, stretches, own)
        found.append(Channel(name, said, measured, kind, name, float(m.sensor_delay[i])))
    return found, tuple(left_out)


def _units(scene: Scene, joint: str) -> Mapping[str, str]:
    units = units_at(scene, Location("joint", joint))
    return {"q": units.position, "f": units.force}


def _at_samples(parts: Sequence[Part], stretches: Sequence[Stretch], names: Sequence[str]) -> Array:
    """Columns of recordings at the samples of stretches, (N, names); NaN where missing."""
    whole = {part.index: part.recording for part in parts}
    clocks = {index: stamps(recording) for index, recording in whole.items()}
    tables = []
    for s in stretches:
        rows = np.searchsorted(clocks[s.recording], s.t)
        missing = np.full(len(s.t), np.nan)
        have = whole[s.recording].columns
        tables.append(np.stack([have[n][rows] if n in have else missing for n in names], axis=1))
    return np.concatenate(tables)


def _rms(predicted: Array, channel: Channel) -> float | None:
    measured = channel.measured
    if channel.kind == "FRAMEQUAT":  # a rotation has two quaternions
        measured = measured * np.where((predicted * measured).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    error = predicted - measured
    return float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else None


ENCODERS = {"JOINTPOS": "{q}", "JOINTVEL": "{q}/s"}
MOTION = ENCODERS | {
    "ACCELEROMETER": "m/s²",
    "VELOCIMETER": "m/s",
    "GYRO": "rad/s",
    "MAGNETOMETER": "T",
    "ACTUATORPOS": "{q}",
    "ACTUATORVEL": "{q}/s",
    "TENDONPOS": "{q}",
    "TENDONVEL": "{q}/s",
    "FRAMEPOS": "m",
    "FRAMEQUAT": "",
    "FRAMEXAXIS": "",
    "FRAMEYAXIS": "",
    "FRAMEZAXIS": "",
    "FRAMELINVEL": "m/s",
    "FRAMEANGVEL": "rad/s",
    "FRAMELINACC": "m/s²",
    "FRAMEANGACC": "rad/s²",
}
"""Sensors that the joints' path decides, with their units; {q} is that of the joint's position."""
FORCES = {
    "ACTUATORFRC": "{f}",
    "JOINTACTFRC": "{f}",
    "TENDONACTFRC": "{f}",
    "FORCE": "N",
    "TORQUE": "N·m",
}
"""Sensors that need the forces too; {f} is the unit of the joint's force."""
_MOST_ROWS = 8000
"""At most so many samples are compared, evenly spread."""


@dataclass(frozen=True, eq=False)
class Channel:
    """A sensor that was recorded.

    Attributes:
        name: as in :class:`SensorError`.
        unit: of what it reports.
        measured: (N, dim), NaN where missing.
        kind: of an MJCF sensor, without the prefix; ``ACTUATORFRC`` of a measured force too.
        source: name of the MJCF sensor, or of the actuator.
        delay: with which the model says that it reports [s].
    """

    name: str
    unit: str
    measured: Array
    kind: str
    source: str
    delay: float = 0.0

    def of(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """What it reports in a state, (dim,)."""
        if self.name.startswith("force/"):
            return np.array(data.actuator_force[[model.actuator(self.source).id]])
        start = int(model.sensor(self.source).adr[0])
        return np.array(data.sensordata[start : start + self.measured.shape[1]])


def predicted(
    scene: Scene, holdout: Holdout, hypothesis: Hypothesis, step: float, channels: Sequence[Channel]
) -> dict[str, Array]:
    """What each sensor reports in replays, (N, dim) each; NaN where that is not known."""
    replayer = Replayer(scene, [_beside(s, step) for s in holdout.stretches], step)
    told = replayer.run([hypothesis])
    path, reported = told, (told.q[0], told.v[0])
    sensing = [p for p in hypothesis if isinstance(p.effect, OnOutputs)]
    if sensing:
        # what only the joints' encoders say moves no other sensor
        bodily = tuple(p for p in hypothesis if p not in sensing)
        starts = [_true_start(scene, s, sensing) for s in replayer.stretches]
        path = Replayer(scene, starts, step).run([bodily])
    state = _States(scene, replayer, hypothesis)
    found = {c.name: np.full((2, *c.measured.shape), np.nan) for c in channels}
    thin = max(1, sum(len(s.t) for s in holdout.stretches) // _MOST_ROWS)
    start = fine = 0
    for s in holdout.stretches:
        rows, beside = slice(start, start + len(s.t)), slice(fine, fine + 3 * len(s.t) - 2)
        start, fine = rows.stop, beside.stop
        (_, q, _), (early, v, late) = (_apart(x[0, beside]) for x in (path.q, path.v))
        # just before a sample's command acts, and just after
        rates = (v - early, late - v)
        rates[0][0], rates[1][-1] = rates[1][0], rates[0][-1]
        for when, (rate, u) in enumerate(zip(rates, state.commands(s), strict=True)):
            states = (q, v, rate / _near(s, step), u)
            _read(state, states, thin, {c: found[c.name][when, rows] for c in channels})
        for c in channels:
            if c.kind in ENCODERS:
                which = reported[list(ENCODERS).index(c.kind)]
                found[c.name][:, rows, 0] = _apart(which[beside])[1][:, _dof(scene, c)]
            if c.delay > 0.0:
                for values in found[c.name][:, rows]:
                    values[:] = _late(s.t, values, c.delay)
    return {c.name: _moment(found[c.name], c.measured) for c in channels}


def _near(s: Stretch, step: float) -> float:
    """How close to a sample the path is looked at for its acceleration [s]."""
    return min(step, 0.25 * s.dt)


def _beside(s: Stretch, step: float) -> Stretch:
    """The same stretch, sampled just before and just after each sample too."""
    near, before = _near(s, step), np.vstack([s.command[:1], s.command[:-1]])
    t = np.stack([s.t - near, s.t, s.t + near], axis=1).reshape(-1)
    command = np.stack([before, s.command, s.command], axis=1).reshape(len(t), -1)
    return replace(s, t=t[1:-1], command=command[1:-1])


def _apart(path: Array) -> tuple[Array, Array, Array]:
    """What comes just before, at and just after each sample of a path (3 K − 2, n), (K, n) each."""
    three = np.vstack([path[:1], path, path[-1:]]).reshape(-1, 3, path.shape[1])
    return three[:, 0], three[:, 1], three[:, 2]


def _read(
    state: _States,
    path: tuple[Array, Array, Array, Array],
    thin: int,
    into: Mapping[Channel, Array],
) -> None:
    """Read sensors along a path of position, velocity, acceleration (K, nv) and command (K, nu)."""
    for k in range(0, len(path[0]), thin):
        if all(np.isfinite(x[k]).all() for x in path[:3]):
            model, data = state.set(*(x[k] for x in path))
            for channel, values in into.items():
                if state.exact or channel.kind in MOTION:
                    values[k] = channel.of(model, data)


def _moment(both: Array, measured: Array) -> Array:
    """What a sensor reads before and after commands act, (2, N, dim), mixed as fits best.

    Accelerations and forces jump where a command does, and nobody says when a sample is read.
    """
    before, change = both[0], both[1] - both[0]
    known = np.isfinite(before) & np.isfinite(change) & np.isfinite(measured)
    size = float((change[known] ** 2).sum())
    share = (change[known] @ (measured - before)[known]) / size if size > 0.0 else 0.0
    return np.asarray(before + np.clip(share, 0.0, 1.0) * change)


def _dof(scene: Scene, channel: Channel) -> int:
    return scene.dof(joint_of_sensor(scene.model, int(scene.model.sensor(channel.source).id)))


def _late(t: Array, values: Array, delay: float) -> Array:
    """A signal (K, dim) that arrives late, for those rows that are known."""
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        return values
    late = [np.interp(t - delay, t[known], column[known]) for column in values.T]
    return np.stack(late, axis=1)


def _true_start(scene: Scene, s: Stretch, sensing: Sequence[Planted]) -> Stretch:
    """A stretch that starts where the machine was, and not where its encoders said."""
    said = Outputs(s.recording, s.t[:1], s.q0[None].copy(), s.v0[None].copy())
    for p in sensing:
        p.sense(said, scene)
    return replace(s, q0=2.0 * s.q0 - said.q[0], v0=2.0 * s.v0 - said.v[0])


class _States:
    """States of a machine in which sensors are read.

    Attributes:
        exact: whether all forces that a hypothesis adds are known from the joints' state alone.
            Rotors of their own, laws that act step by step and pushes are not.
    """

    def __init__(self, scene: Scene, replayer: Replayer, hypothesis: Hypothesis) -> None:
        self.scene, self.step, self.hypothesis = scene, replayer.step, hypothesis
        model = replayer.compile(hypothesis)
        lagging = model.na > 0 or bool((model.actuator_delay > 0.0).any())
        live = any(is_live(p.effect) for p in hypothesis)
        self.exact = model.nq == scene.model.nq and not lagging and not live
        if model.nq != scene.model.nq:
            model = replayer.compile(())
        model.sensor_delay[:] = 0.0  # there is no past in which a buffer could have been filled
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        self.model, self.data = model, mujoco.MjData(model)
        joints = [model.joint(name) for name in scene.joints]
        self._q = np.array([int(j.qposadr[0]) for j in joints])
        self._v = np.array([int(j.dofadr[0]) for j in joints])
        # patches add motors without commands
        self._u = [
            scene.model.actuator(model.actuator(i).name).id
            for i in range(model.nactuator)
            for _ in range(model.actuator_ctrlnum[i])
        ]

    def commands(self, s: Stretch) -> tuple[Array, Array]:
        """Commands in force just before and just after the samples of a stretch, (K, nu) each."""
        steps = int(np.ceil((s.t[-1] - s.t[0]) / self.step)) + 1
        t = s.t[0] + self.step * np.arange(steps)
        inputs = Inputs(s.recording, t, self.step, s.commands(self.step, steps))
        for p in self.hypothesis:
            p.drive(inputs, self.scene)
        self.exact &= not inputs.force
        at = np.round((s.t - s.t[0]) / self.step).astype(int)
        return inputs.u[np.maximum(at - 1, 0)], inputs.u[np.minimum(at + 1, steps - 1)]

    def set(self, q: Array, v: Array, a: Array, u: Array) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Position, velocity, acceleration and command of the joints, (nv,) and (nu,)."""
        m, d = self.model, self.data
        d.qpos[self._q], d.qvel[self._v], d.ctrl[:] = q, v, u[self._u]
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_fwdActuation(m, d)
        d.qacc[self._v] = a
        mujoco.mj_inverse(m, d)
        return m, d


def joint_of_sensor(m: mujoco.MjModel, sensor: int) -> str:
    """The joint whose units a sensor of a joint or actuator has; "" for others."""
    of, i = int(m.sensor_objtype[sensor]), int(m.sensor_objid[sensor])
    if of == mujoco.mjtObj.mjOBJ_ACTUATOR and m.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT:
        of, i = int(mujoco.mjtObj.mjOBJ_JOINT), int(m.actuator_trnid[i, 0])
    return str(m.joint(i).name) if of == mujoco.mjtObj.mjOBJ_JOINT else ""
