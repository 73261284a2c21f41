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

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.experiment import SOURCE
from wt.diagnose.experiment.motions import mild, programme, telling_joints
from wt.diagnose.experiment.reach import Reach, Shown, reach_of, roomy, too_far
from wt.diagnose.experiment.release import passive, release
from wt.diagnose.experiment.trial import Trial, as_recording, trial
from wt.diagnose.result import Diagnosis
from wt.errors import RecordingError, WorkError
from wt.physics.scene import Scene
from wt.types import Recording

SHORTEST_S = 10.0
_SHRINK = 0.8
_TRIES = 20


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
    shown = [
        Shown(t.name, t.role == "holdout", t.recorded, t.velocity, t.before)
        for t in diagnosis.traces
    ]
    return excite(
        scene, reach_of(scene, shown), _focus(scene, diagnosis), seconds, rate, SOURCE, seed
    )


def excite(
    scene: Scene,
    reach: Reach,
    focus: Sequence[str],
    seconds: float,
    rate: float,
    source: str,
    seed: int = 0,
) -> Recording:
    """Commands that move some joints one after another, or all of them mildly.

    Args:
        scene: the machine.
        reach: what its joints may do.
        focus: joints to move, most important first; all where it is empty.
        seconds: length.
        rate: of the commands [Hz].
        source: what asks for it, for the metadata.
        seed: of the steps.

    Raises:
        WorkError: no motion was found that keeps the limits.
    """
    if not any(roomy(reach, drive.dof) for drive in scene.drives):
        raise WorkError(
            "no driven joint has a range in the model or moved in the recordings: nothing says how "
            "far one may go; give the joints a range"
        )
    focus, n = [j for j in focus if roomy(reach, scene.dof(j))], round(seconds * rate) + 1
    wanted = _motion(scene, reach, focus, n, 1.0 / rate, np.random.default_rng(seed))
    what = f"moves {', '.join(focus)} in turn" if focus else "moves all joints together"
    size = np.ones(len(scene.joints))
    for _ in range(_TRIES):
        tried = trial(scene, reach.smaller(wanted, size), rate)
        wrong = too_far(scene, reach, tried, rate)
        if not wrong.any():
            return as_recording(scene, tried, rate, source, what)
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
    joints = [joint for at in places for joint in telling_joints(scene, at) if joint in driven]
    return tuple(dict.fromkeys(joints))


def _motion(
    scene: Scene, reach: Reach, focus: Sequence[str], n: int, dt: float, rng: np.random.Generator
) -> Float[np.ndarray, "sample dof"]:
    """Joint positions: focused joints in turn, or all together if there are none."""
    q = np.tile(reach.rest, (n, 1))
    if not focus:
        driven = dict.fromkeys(d.joint for d in scene.drives if roomy(reach, d.dof))
        for turn, joint in enumerate(driven):
            q[:, scene.dof(joint)] = mild(scene, reach, joint, n, dt, turn)
        return q
    # a programme needs some ten seconds; what is less important waits for another recording
    focus = focus[: max(1, int(n * dt / SHORTEST_S))]
    for i, joint in enumerate(focus):
        part = slice(i * n // len(focus), (i + 1) * n // len(focus))
        count, dof = part.stop - part.start, scene.dof(joint)
        if any(d.servo for d in scene.drives if d.joint == joint):
            q[part, dof] = programme(reach, dof, count, dt, rng)
        else:
            q[part, dof] = mild(scene, reach, joint, count, dt, 0)
    return q
