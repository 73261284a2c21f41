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
from jaxtyping import Float

from wt.diagnose.evidence import SensorError
from wt.diagnose.observed.states import States
from wt.diagnose.recordings.samples import Part, stamps
from wt.diagnose.selection.holdout import Holdout
from wt.physics.hooks import OnOutputs
from wt.physics.planted import Hypothesis, Planted
from wt.physics.replay import Outputs, Stretch
from wt.physics.rollout import Replayer, Replays
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location


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
    compared = []
    for channel in channels:
        errors = [_rms(x[channel.name], channel) for x in (before, after)]
        if errors[0] is not None:
            compared.append(SensorError(channel.name, channel.unit, errors[0], errors[1]))
    return tuple(compared), left_out


def _recorded(
    scene: Scene, parts: Sequence[Part], stretches: Sequence[Stretch]
) -> tuple[list[SensorChannel], tuple[str, ...]]:
    """Recorded sensors besides the joints, at the samples of all stretches."""
    columns = {name for part in parts for name in part.recording.columns}
    channels = [
        SensorChannel(
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
        shown = unit.format(**_units(scene, joint_of_sensor(m, i)))
        measured = _at_samples(parts, stretches, own)
        channels.append(SensorChannel(name, shown, measured, kind, name, float(m.sensor_delay[i])))
    return channels, tuple(left_out)


def _units(scene: Scene, joint: str) -> Mapping[str, str]:
    units = units_at(scene, Location("joint", joint))
    return {"q": units.position, "f": units.force}


def _at_samples(
    parts: Sequence[Part], stretches: Sequence[Stretch], names: Sequence[str]
) -> Float[np.ndarray, "sample column"]:
    """Columns of recordings at the samples of stretches; NaN where missing."""
    recordings = {part.index: part.recording for part in parts}
    clocks = {index: stamps(recording) for index, recording in recordings.items()}
    tables = []
    for s in stretches:
        rows = np.searchsorted(clocks[s.recording], s.t)
        missing = np.full(len(s.t), np.nan)
        have = recordings[s.recording].columns
        tables.append(np.stack([have[n][rows] if n in have else missing for n in names], axis=1))
    return np.concatenate(tables)


def _rms(predicted: Float[np.ndarray, "sample reading"], channel: SensorChannel) -> float | None:
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
"""Samples that are compared at most, evenly spread."""


@dataclass(frozen=True, eq=False)
class SensorChannel:
    """A sensor that was recorded.

    Attributes:
        name: as in :class:`SensorError`.
        unit: of what it reports.
        measured: its readings; NaN where missing.
        kind: of an MJCF sensor, without the prefix; ``ACTUATORFRC`` of a measured force too.
        source: name of the MJCF sensor, or of the actuator.
        delay: of its reports, as the model has it [s].
    """

    name: str
    unit: str
    measured: Float[np.ndarray, "sample reading"]
    kind: str
    source: str
    delay: float = 0.0

    def of(self, model: mujoco.MjModel, data: mujoco.MjData) -> Float[np.ndarray, " reading"]:
        """Where its reading stands in ``data``, whose states come and go."""
        if self.name.startswith("force/"):
            actuator = int(model.actuator(self.source).id)
            return np.asarray(data.actuator_force[actuator : actuator + 1])
        start = int(model.sensor(self.source).adr[0])
        return np.asarray(data.sensordata[start : start + self.measured.shape[1]])


def predicted(
    scene: Scene,
    holdout: Holdout,
    hypothesis: Hypothesis,
    step: float,
    channels: Sequence[SensorChannel],
) -> dict[str, Float[np.ndarray, "sample _"]]:
    """Readings of each sensor in replays; NaN where they are not known."""
    replayer = Replayer(scene, [_with_neighbours(s, step) for s in holdout.stretches], step)
    replays = replayer.run([hypothesis])
    path = _true_path(scene, replayer, hypothesis, step) or replays
    state = States(scene, replayer, hypothesis)
    readings = {c: np.full((2, *c.measured.shape), np.nan) for c in channels}
    thin = max(1, sum(len(s.t) for s in holdout.stretches) // _MOST_ROWS)
    start = fine = 0
    for s in holdout.stretches:
        rows, dense = slice(start, start + len(s.t)), slice(fine, fine + 3 * len(s.t) - 2)
        start, fine = rows.stop, dense.stop
        here = {c: values[:, rows] for c, values in readings.items()}
        _read_stretch(state, s, thin, _near(s, step), (path.q[0, dense], path.v[0, dense]), here)
        for c, values in here.items():
            if c.kind in ENCODERS:
                reported = (replays.q, replays.v)[list(ENCODERS).index(c.kind)]
                values[:, :, 0] = _apart(reported[0, dense])[1][:, _dof(scene, c)]
            if c.delay > 0.0:
                for moment in values:
                    moment[:] = _late(s.t, moment, c.delay)
    return {c.name: _moment(values, c.measured) for c, values in readings.items()}


def _true_path(
    scene: Scene, replayer: Replayer, hypothesis: Hypothesis, step: float
) -> Replays | None:
    """Replays of where the machine is, not of what its encoders say; None if they say the same."""
    sensing = [p for p in hypothesis if isinstance(p.effect, OnOutputs)]
    if not sensing:
        return None
    # what only the joints' encoders say moves no other sensor
    bodily = tuple(p for p in hypothesis if p not in sensing)
    starts = [_true_start(scene, s, sensing) for s in replayer.stretches]
    return Replayer(scene, starts, step).run([bodily])


def _read_stretch(
    state: States,
    s: Stretch,
    thin: int,
    near: float,
    path: tuple[Float[np.ndarray, "dense dof"], Float[np.ndarray, "dense dof"]],
    into: Mapping[SensorChannel, Float[np.ndarray, "2 sample _"]],
) -> None:
    """Read sensors along a stretch, just before each sample's command acts and just after.

    Args:
        state: the machine.
        s: the stretch.
        thin: one of this many samples is read.
        near: distance of a sample from its neighbours in the path [s].
        path: positions and velocities with neighbours.
        into: readings before and after, written in place.
    """
    (_, q, _), (early, v, late) = (_apart(x) for x in path)
    rates = (v - early, late - v)
    rates[0][0], rates[1][-1] = rates[1][0], rates[0][-1]
    for when, (rate, u) in enumerate(zip(rates, state.commands(s), strict=True)):
        moment = {channel: values[when] for channel, values in into.items()}
        _read(state, (q, v, rate / near, u), thin, moment)


def _near(s: Stretch, step: float) -> float:
    """Distance from a sample at which the path is looked at for its acceleration [s]."""
    return min(step, 0.25 * s.dt)


def _with_neighbours(s: Stretch, step: float) -> Stretch:
    """The same stretch, sampled just before and just after each sample too."""
    near, before = _near(s, step), np.vstack([s.command[:1], s.command[:-1]])
    t = np.stack([s.t - near, s.t, s.t + near], axis=1).reshape(-1)
    command = np.stack([before, s.command, s.command], axis=1).reshape(len(t), -1)
    return replace(s, t=t[1:-1], command=command[1:-1])


def _apart(
    path: Float[np.ndarray, "dense dof"],
) -> tuple[
    Float[np.ndarray, "sample dof"],
    Float[np.ndarray, "sample dof"],
    Float[np.ndarray, "sample dof"],
]:
    """A path just before, at and just after each of K samples, from its 3 K − 2 points."""
    three = np.vstack([path[:1], path, path[-1:]]).reshape(-1, 3, path.shape[1])
    return three[:, 0], three[:, 1], three[:, 2]


def _read(
    state: States,
    path: tuple[
        Float[np.ndarray, "sample dof"],
        Float[np.ndarray, "sample dof"],
        Float[np.ndarray, "sample dof"],
        Float[np.ndarray, "sample command"],
    ],
    thin: int,
    into: Mapping[SensorChannel, Float[np.ndarray, "sample _"]],
) -> None:
    """Read sensors along a path of position, velocity, acceleration and command."""
    readings = [
        (channel.of(state.model, state.data), values)
        for channel, values in into.items()
        if state.exact or channel.kind in MOTION
    ]
    known = np.isfinite(np.hstack(path[:3])).all(axis=1)
    for k in range(0, len(known), thin):
        if known[k]:
            state.set(*(x[k] for x in path))
            for reading, values in readings:
                values[k] = reading


def _moment(
    both: Float[np.ndarray, "2 sample reading"], measured: Float[np.ndarray, "sample reading"]
) -> Float[np.ndarray, "sample reading"]:
    """Readings of a sensor before and after commands act, mixed as fits best.

    Accelerations and forces jump where a command does, and nobody says when a sample is read.
    """
    before, change = both[0], both[1] - both[0]
    known = np.isfinite(before) & np.isfinite(change) & np.isfinite(measured)
    size = float((change[known] ** 2).sum())
    share = (change[known] @ (measured - before)[known]) / size if size > 0.0 else 0.0
    return np.asarray(before + np.clip(share, 0.0, 1.0) * change)


def _dof(scene: Scene, channel: SensorChannel) -> int:
    return scene.dof(joint_of_sensor(scene.model, int(scene.model.sensor(channel.source).id)))


def _late(
    t: Float[np.ndarray, " sample"], values: Float[np.ndarray, "sample reading"], delay: float
) -> Float[np.ndarray, "sample reading"]:
    """A signal that arrives late, for those rows that are known."""
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        return values
    late = [np.interp(t - delay, t[known], column[known]) for column in values.T]
    return np.stack(late, axis=1)


def _true_start(scene: Scene, s: Stretch, sensing: Sequence[Planted]) -> Stretch:
    """A stretch that starts where the machine was, and not where its encoders said."""
    reported = Outputs(s.recording, s.t[:1], s.q0[None].copy(), s.v0[None].copy())
    for p in sensing:
        p.sense(reported, scene)
    return replace(s, q0=2.0 * s.q0 - reported.q[0], v0=2.0 * s.v0 - reported.v[0])


def joint_of_sensor(m: mujoco.MjModel, sensor: int) -> str:
    """The joint whose units a sensor of a joint or actuator has; "" for others."""
    of, i = int(m.sensor_objtype[sensor]), int(m.sensor_objid[sensor])
    if of == mujoco.mjtObj.mjOBJ_ACTUATOR and m.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT:
        of, i = int(mujoco.mjtObj.mjOBJ_JOINT), int(m.actuator_trnid[i, 0])
    return str(m.joint(i).name) if of == mujoco.mjtObj.mjOBJ_JOINT else ""
