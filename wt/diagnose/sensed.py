"""Further sensors, measured and in replays: gyros, accelerometers, encoders, actuator forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from wt.diagnose.assessed import Hypothesis
from wt.diagnose.evidence import SensorError
from wt.diagnose.proof import Held
from wt.diagnose.readings import FORCES, MOTION, Channel, joint_of_sensor, predicted
from wt.diagnose.samples import Part, stamps
from wt.physics.replay import Stretch
from wt.physics.scene import Scene

Array = np.ndarray


def sensed(
    parts: Sequence[Part], held: Held, hypothesis: Hypothesis, step: float
) -> tuple[tuple[SensorError, ...], tuple[str, ...]]:
    """Errors of replays of held-out recordings at every further sensor that was recorded.

    Args:
        parts: the held-out recordings.
        held: the same, ready to be replayed.
        hypothesis: the findings.
        step: physics step of the replays [s].

    Returns:
        (errors, names of sensors that cannot be compared).
    """
    scene = held.smoothed.motion.scene
    channels, left_out = _recorded(scene, parts, held.stretches)
    if not channels:
        return (), left_out
    before = predicted(scene, held, (), step, channels)
    after = predicted(scene, held, held.here(hypothesis), step, channels) if hypothesis else before
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
    slide = joint and scene.model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    return {"q": "m", "f": "N"} if slide else {"q": "rad", "f": "N·m"}


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
