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
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.experiment import SOURCE, signals
from wt.diagnose.experiment.reach import MILD, Reach, Shown, reach_of, roomy, too_far
from wt.diagnose.experiment.release import passive, release
from wt.diagnose.experiment.trial import Trial, trial
from wt.diagnose.result import Diagnosis
from wt.errors import RecordingError, WorkError
from wt.physics.scene import Scene
from wt.types import Location, Recording

SHORTEST_S = 10.0
_RAMP_S = 1.5
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
    shown = [Shown(t.role == "holdout", t.recorded, t.velocity, t.before) for t in diagnosis.traces]
    reach = reach_of(scene, shown)
    if not any(roomy(reach, drive.dof) for drive in scene.drives):
        raise WorkError(
            "no driven joint has a range in the model or moved in the recordings: nothing says how "
            "far one may go; give the joints a range"
        )
    focus = [j for j in _focus(scene, diagnosis) if roomy(reach, scene.dof(j))]
    wanted = _motion(scene, reach, focus, n, 1.0 / rate, np.random.default_rng(seed))
    size = np.ones(len(scene.joints))
    for _ in range(_TRIES):
        tried = trial(scene, reach.rest + size * (wanted - reach.rest), rate)
        wrong = too_far(scene, reach, tried, rate)
        if not wrong.any():
            return _recording(scene, tried, rate, focus)
        size[wrong] *= _SHRINK
    raise _none_safe(scene, reach, tried, wrong)


def _none_safe(
    scene: Scene, reach: Reach, tried: Trial, wrong: Bool[np.ndarray, " dof"]
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
    scene: Scene, reach: Reach, focus: Sequence[str], n: int, dt: float, rng: np.random.Generator
) -> Float[np.ndarray, "sample dof"]:
    """Joint positions: focused joints in turn, or all together if there are none."""
    q = np.tile(reach.rest, (n, 1))
    if not focus:
        driven = dict.fromkeys(d.joint for d in scene.drives if roomy(reach, d.dof))
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
    reach: Reach, dof: int, n: int, dt: float, rng: np.random.Generator
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
    scene: Scene, reach: Reach, joint: str, n: int, dt: float, turn: int
) -> Float[np.ndarray, " sample"]:
    """A small multisine of one joint around its rest."""
    dof = scene.dof(joint)
    servo = any(d.servo for d in scene.drives if d.joint == joint)
    half = 0.5 * float(reach.high[dof] - reach.low[dof])
    size = min(0.3 * half, MILD)
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
