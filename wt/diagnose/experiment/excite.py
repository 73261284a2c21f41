"""A motion to record next: it separates causes that the recordings so far could not tell apart.

Joints of findings with rivals are moved one after another: slow reversals at three speeds (dry
friction against viscous, Stribeck), steps (delay against lag), a multisine (inertia, delay against
damping) and rests at several angles (friction under load, springs, gains). With no rivals, all
joints move together by a mild multisine. Joints with torque motors, which no command can hold
still, get a mild multisine around the pose where gravity leaves them. The motion starts and ends at
rest where the machine stands, stays at speeds that were recorded and inside what the model's limits
allow or, where it has none, inside what was recorded: beyond may be a wall. It is simulated on the
model as given, and made smaller until nothing touches and no limit is met.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.experiment import SOURCE, signals
from wt.diagnose.experiment.release import passive, release
from wt.diagnose.experiment.trial import Trial, command, settled, trial
from wt.diagnose.result import Diagnosis
from wt.errors import RecordingError, WorkError
from wt.physics.scene import Scene
from wt.types import Location, Recording

SHORTEST_S = 10.0
_RAMP_S = 1.5
_MILD = 0.3  # rad, rad/s (m, m/s): of joints that were never seen moving
_EDGE = 0.05  # share of a joint's range that is left out at either end
_SLACK, _ROUNDING = 0.002, 1e-6  # share of what was recorded, and [rad or m], for simulation's sake
_NO_ROOM = 1e-4  # rad or m
_STILL = 0.02  # of the fastest: what stands
_SHRINK = 0.8
_TRIES = 20
# shares of a joint's time
_SLOW, _STEPS, _SINES = (0.18, 0.13, 0.13), 0.14, 0.24
_SPEEDS = (0.06, 0.2, 0.6)  # of reversals, as shares of the fastest recorded
_CREEP = 0.03  # rad/s: slow enough for Stribeck's curve
_TORQUE_BAND = (0.2, 2.0)


def suggest(
    diagnosis: Diagnosis,
    model: str | Path,
    *,
    seconds: float = 30.0,
    rate_hz: float | None = None,
    seed: int = 0,
) -> Recording:
    """Commands that separate a diagnosis's findings from their rivals, and the motion to expect.

    Args:
        diagnosis: of the recordings so far, with their traces.
        model: the MJCF as given.
        seconds: length.
        rate_hz: of the commands; by default that of the recordings.
        seed: of the steps.

    Returns:
        ``ctrl/<actuator>`` to send and the predicted ``qpos/<joint>``.

    Raises:
        ModelError: the MJCF cannot be used.
        RecordingError: it is to be shorter than 10 s.
        WorkError: no motion was found that keeps the limits, or nothing drives the machine.
    """
    if seconds < SHORTEST_S:
        raise RecordingError(
            f"an experiment of {seconds:g} s is too short to separate anything; ask for at least "
            f"{SHORTEST_S:g} s"
        )
    scene = Scene(model)
    if passive(scene):
        raise WorkError(
            f"the model has no actuator to command; instead {release(scene, diagnosis.traces)}"
        )
    rates = [r.rate_hz for r in diagnosis.recordings]
    rate = rate_hz or (float(np.round(np.median(rates))) if rates else 200.0)
    n = round(seconds * rate) + 1
    reach = _reach(scene, diagnosis)
    if not any(_roomy(reach, drive.dof) for drive in scene.drives):
        raise WorkError(
            "no driven joint has a range in the model or moved in the recordings: nothing says how "
            "far one may go; give the joints a range"
        )
    focus = [j for j in _focus(scene, diagnosis) if _roomy(reach, scene.dof(j))]
    wanted = _motion(scene, reach, focus, n, 1.0 / rate, np.random.default_rng(seed))
    size = np.ones(len(scene.joints))
    for _ in range(_TRIES):
        tried = trial(scene, reach.rest + size * (wanted - reach.rest), rate)
        wrong = _wrong(scene, reach, tried, rate)
        if not wrong.any():
            return _recording(scene, tried, rate, focus)
        size[wrong] *= _SHRINK
    raise _none_safe(scene, reach, tried, wrong)


def _none_safe(
    scene: Scene, reach: _Reach, tried: Trial, wrong: Bool[np.ndarray, " dof"]
) -> WorkError:
    """The error that says why even the smallest motion was none."""
    if len(tried.touched):
        bodies = " and ".join(scene.model.body(int(i)).name for i in tried.touched[0])
        why = f"bodies {bodies} touch"
    else:
        why = f"joint {scene.joints[int(np.argmax(wrong))]} leaves its limits"
    return WorkError(
        f"no safe motion was found from the pose {np.round(reach.rest, 2).tolist()}: {why}; "
        "record from a pose with more room"
    )


@dataclass(frozen=True, eq=False)
class _Reach:
    """Positions and speeds that joints may have [rad, rad/s].

    Attributes:
        rest: the pose at the start and the end.
        low: smallest position.
        high: largest.
        slack: by how much a simulated motion may leave these, at either end.
        speed: greatest speed.
    """

    rest: Float[np.ndarray, " dof"]
    low: Float[np.ndarray, " dof"]
    high: Float[np.ndarray, " dof"]
    slack: Float[np.ndarray, "end dof"]
    speed: Float[np.ndarray, " dof"]


def _reach(scene: Scene, diagnosis: Diagnosis) -> _Reach:
    """From what was recorded, inside what the model allows."""
    count = len(scene.joints)
    seen_low, seen_high = np.full(count, np.inf), np.full(count, -np.inf)
    speed = np.full(count, _MILD)
    for trace in diagnosis.traces:
        recorded = np.where(np.isfinite(trace.recorded), trace.recorded, trace.before)
        seen_low = np.fmin(seen_low, np.nanmin(recorded, axis=0))
        seen_high = np.fmax(seen_high, np.nanmax(recorded, axis=0))
        speed = np.fmax(speed, np.nanquantile(np.abs(trace.velocity), 0.995, axis=0))
    stands = _stands(scene, diagnosis)
    around = 0.0 if diagnosis.traces else _MILD  # nothing was shown: near where it stands
    seen_low = np.fmin(seen_low, stands - around)
    seen_high = np.fmax(seen_high, stands + around)
    (low, high), margin = _allowed(scene)
    known = np.isfinite([low, high])  # by the model
    rest = settled(scene, stands, 0.5 * (seen_low + seen_high))
    # what falls without end is held where it stands, and so is what nothing has shown to settle so
    lost = (rest < np.where(known[0], low - margin, seen_low)) | (
        rest > np.where(known[1], high + margin, seen_high)
    )
    rest = np.where(lost, stands, rest)
    room = np.maximum(0.1 * (seen_high - seen_low), 0.0)
    low = np.where(known[0], np.maximum(low, np.minimum(seen_low - room, rest - _MILD)), seen_low)
    high = np.where(
        known[1], np.minimum(high, np.maximum(seen_high + room, rest + _MILD)), seen_high
    )
    low, high = np.minimum(low, rest), np.maximum(high, rest)
    slack = np.where(known, 0.1, _SLACK) * (high - low) + _ROUNDING
    return _Reach(rest, low, high, slack, speed)


def _roomy(reach: _Reach, dof: int) -> bool:
    """Whether a joint has room to move in."""
    return bool(reach.high[dof] - reach.low[dof] > _NO_ROOM)


def _stands(scene: Scene, diagnosis: Diagnosis) -> Float[np.ndarray, " dof"]:
    """Pose in which the machine stands: at the end of the last recording, or its start.

    Where it moves at either, in the most quiet moment of that recording.
    """
    rest = scene.model.qpos0.copy()
    if not diagnosis.traces:
        return rest
    # the last that were given are held out
    latest = [t for t in diagnosis.traces if t.role == "holdout"] or list(diagnosis.traces)
    last, first = latest[-1], next(t for t in diagnosis.traces[::-1] if t.name == latest[-1].name)
    speeds = [np.abs(np.nan_to_num(t.velocity)).max(axis=1) for t in (last, first)]
    still = _STILL * max(float(s.max()) for s in speeds)
    if speeds[0][-1] <= still:
        pose = last.recorded[-1]
    elif speeds[1][0] <= still:
        pose = first.recorded[0]
    else:
        pose = last.recorded[int(speeds[0].argmin())]
    return np.where(np.isfinite(pose), pose, rest)


def _allowed(
    scene: Scene,
) -> tuple[tuple[Float[np.ndarray, " dof"], Float[np.ndarray, " dof"]], Float[np.ndarray, " dof"]]:
    """Positions that joints' ranges and servos' commands allow, and the margin kept to those.

    Infinite where nothing is said.
    """
    m = scene.model
    low, high = np.full(m.njnt, -np.inf), np.full(m.njnt, np.inf)
    limited = m.jnt_limited.astype(bool)
    margin = _EDGE * np.ptp(m.jnt_range, axis=1)
    low[limited] = (m.jnt_range[:, 0] + margin)[limited]
    high[limited] = (m.jnt_range[:, 1] - margin)[limited]
    for drive in scene.drives:
        if drive.servo and drive.gain and m.actuator_ctrllimited[drive.index]:
            zero, slope = command(drive, 0.0, 0.0, 0.0), command(drive, 1.0, 0.0, 0.0)
            ends = np.sort((m.actuator_ctrlrange[drive.index] - zero) / (slope - zero))
            low[drive.dof] = max(low[drive.dof], ends[0])
            high[drive.dof] = min(high[drive.dof], ends[1])
    return (low, high), np.where(limited, margin, 0.0)


def _focus(scene: Scene, diagnosis: Diagnosis) -> tuple[str, ...]:
    """Joints to move so that findings and their rivals come apart, most important first."""
    places = []
    for finding in diagnosis.findings:
        for rival in finding.confusable_with:
            places += [finding.at, rival.at]
    driven = {drive.joint for drive in scene.drives}
    joints = [joint for at in places for joint in _joints(scene, at) if joint in driven]
    return tuple(dict.fromkeys(joints))


def _joints(scene: Scene, at: Location) -> Sequence[str]:
    """The joints that tell most about a place."""
    m = scene.model
    if at.name in scene.joints and at.kind in ("joint", "sensor"):
        return [at.name]
    if at.kind == "actuator":
        return [drive.joint for drive in scene.driven(at)]
    if at.kind == "pair":
        return [name for name in at.name.split("+") if name in scene.joints]
    if at.kind == "body" and mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, at.name) > 0:
        # what acts on a body is felt most at the joints next to it
        return [j for j in scene.joints if scene.carries(m.body(at.name).id)[scene.dof(j)]][-2:]
    return scene.joints


def _motion(
    scene: Scene, reach: _Reach, focus: Sequence[str], n: int, dt: float, rng: np.random.Generator
) -> Float[np.ndarray, "sample dof"]:
    """Joint positions: focused joints in turn, or all together if there are none."""
    q = np.tile(reach.rest, (n, 1))
    if not focus:
        driven = dict.fromkeys(d.joint for d in scene.drives if _roomy(reach, d.dof))
        for turn, joint in enumerate(driven):
            q[:, scene.dof(joint)] = _mild(scene, reach, joint, n, dt, turn)
        return q
    # a programme needs some ten seconds; what is less important waits for another recording
    focus = focus[: max(1, int(n * dt / SHORTEST_S))]
    for i, joint in enumerate(focus):
        part = slice(i * n // len(focus), (i + 1) * n // len(focus))
        count, dof = part.stop - part.start, scene.dof(joint)
        if any(d.servo for d in scene.drives if d.joint == joint):
            q[part, dof] = _programme(reach, dof, count, dt, rng)
        else:
            q[part, dof] = _mild(scene, reach, joint, count, dt, 0)
    return q


def _programme(
    reach: _Reach, dof: int, n: int, dt: float, rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """Reversals, steps, sines and rests of one joint in the middle of its reach."""
    rest, speed = float(reach.rest[dof]), float(reach.speed[dof])
    centre = 0.5 * float(reach.low[dof] + reach.high[dof])
    half = 0.5 * float(reach.high[dof] - reach.low[dof])
    ramp = _ramp(rest, centre, speed, dt)
    left = n - 2 * ramp
    speeds = [speed * share for share in _SPEEDS]
    speeds[0] = min(speeds[0], _CREEP)
    parts = [
        signals.reversals(round(share * left), dt, v, 0.8 * half)
        for share, v in zip(_SLOW, speeds, strict=True)
    ]
    parts.append(signals.steps(round(_STEPS * left), dt, speed, 0.5 * half, rng))
    band = (0.1, min(8.0, 0.1 / dt))
    parts.append(signals.multisine(round(_SINES * left), dt, 0.8 * speed, 0.8 * half, band))
    last = left - sum(map(len, parts))
    parts.append(signals.holds(last, dt, speed, half))
    there = signals.move(rest, centre, ramp)
    return np.concatenate([there, centre + np.concatenate(parts), there[::-1]])


def _mild(
    scene: Scene, reach: _Reach, joint: str, n: int, dt: float, turn: int
) -> Float[np.ndarray, " sample"]:
    """A small multisine of one joint around its rest."""
    dof = scene.dof(joint)
    servo = any(d.servo for d in scene.drives if d.joint == joint)
    half = 0.5 * float(reach.high[dof] - reach.low[dof])
    size = min(0.3 * half, _MILD)
    rest, speed = float(reach.rest[dof]), float(reach.speed[dof])
    # beside an end, away from it; else around the pose where gravity left it
    centre = float(np.clip(rest, reach.low[dof] + size, reach.high[dof] - size))
    ramp = _ramp(rest, centre, speed, dt)
    band = (0.1, min(5.0, 0.1 / dt)) if servo else _TORQUE_BAND
    wave = signals.multisine(n - 2 * ramp, dt, 0.5 * speed, size, band, turn)
    there = signals.move(rest, centre, ramp)
    return np.concatenate([there, centre + wave, there[::-1]])


def _ramp(start: float, end: float, speed: float, dt: float) -> int:
    """Samples of a minimum-jerk move, which peaks at 1.875 times its mean speed."""
    return round(max(_RAMP_S, 1.875 * abs(end - start) / speed) / dt)


def _wrong(scene: Scene, reach: _Reach, tried: Trial, rate: float) -> Bool[np.ndarray, " dof"]:
    """Joints whose motion has to become smaller."""
    m = scene.model
    if not np.isfinite(tried.q).all() or len(tried.touched):
        return np.ones(len(scene.joints), bool)
    low, high = reach.low - reach.slack[0], reach.high + reach.slack[1]
    limited = m.jnt_limited.astype(bool)
    low[limited] = np.maximum(low, m.jnt_range[:, 0])[limited]
    high[limited] = np.minimum(high, m.jnt_range[:, 1])[limited]
    wrong: np.ndarray = np.any((tried.q < low) | (tried.q > high), axis=0)
    # between samples, since a stiff servo jumps after every held command
    speed = np.abs(np.diff(tried.q, axis=0)) * rate
    wrong |= np.any(speed > 1.3 * reach.speed, axis=0)
    for drive in scene.drives:
        i = drive.index
        for limits, values, known in (
            (m.actuator_forcerange[i], tried.force[:, i], m.actuator_forcelimited[i]),
            (m.actuator_ctrlrange[i], tried.ctrl[:, i], m.actuator_ctrllimited[i]),
        ):
            margin = 0.02 * float(np.ptp(limits))
            if known and (values.min() < limits[0] + margin or values.max() > limits[1] - margin):
                wrong[drive.dof] = True
    return wrong


def _recording(scene: Scene, tried: Trial, rate: float, focus: Sequence[str]) -> Recording:
    columns = {
        f"ctrl/{scene.model.actuator(i).name}": tried.ctrl[:, i]
        for i in range(scene.model.nactuator)
    }
    columns |= {f"qpos/{joint}": tried.q[:, scene.dof(joint)] for joint in scene.joints}
    what = f"moves {', '.join(focus)} in turn" if focus else "moves all joints together"
    return Recording(
        np.arange(len(tried.q)) / rate,
        columns,
        {
            "source": SOURCE,
            "rate": rate,
            "notes": f"Commands to send; {what}. Positions are predicted by the model as given, "
            "not measured. Start from the first of them.",
        },
    )
