"""The report's charts: errors over time, what a force depends on, and the horizon."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from wt.diagnose.result import Diagnosis, Finding, Trace
from wt.diagnose.robot_drawing import draw, joint_of
from wt.diagnose.words import number, scaled
from wt.show.charts import Axes, Series, chart
from wt.types import Location

Array = np.ndarray

_OVER_VELOCITY = ("friction", "speed_limit", "drag", "delay", "lag")
_OVER_ACCELERATION = ("armature", "body.inertia")
_OVER_COMMAND = ("gain", "deadband", "saturation")
_OVER_TIME = ("fade", "force_intermittent", "payload_moving")
_BINS, _LEAST = 36, 5
_MOST_TRACES = 4
BEFORE_AFTER = (
    '<span class="key before">model as given</span> <span class="key after">patched model</span>'
)


def model_of(diagnosis: Diagnosis) -> mujoco.MjModel | None:
    """The model as given; None if its file is gone and cannot be compiled without it."""
    try:
        return mujoco.MjModel.from_xml_path(diagnosis.model_path)
    except ValueError:
        pass
    try:
        return mujoco.MjModel.from_xml_string(diagnosis.given_xml)
    except ValueError:
        return None


def full_pose(model: mujoco.MjModel, joints: Sequence[str], positions: Array) -> Array:
    """Generalised positions (T, nq) for those of the named joints (T, n); the rest at rest."""
    qpos = np.tile(model.qpos0, (len(positions), 1))
    for column, name in enumerate(joints):
        qpos[:, int(model.joint(name).qposadr[0])] = positions[:, column]
    return qpos


def filled(t: Array, values: Array) -> Array:
    """Values (T, n) with what is not finite interpolated over time; zero where nothing is known."""
    out = np.array(values, float)
    for column in out.T:
        known = np.isfinite(column)
        column[~known] = np.interp(t[~known], t[known], column[known]) if known.any() else 0.0
    return out


def robot(diagnosis: Diagnosis, model: mujoco.MjModel) -> str:
    """The robot where its error is largest, with its culprits, as a figure."""
    marked = {
        f.at: f.effect.partition(".")[2].replace("_", " ") or f.effect for f in diagnosis.findings
    }
    if not marked and diagnosis.verdict != "no_mismatch":
        marked = {place.at: "unexplained" for place in diagnosis.locations[:1]}
    poses, when = np.tile(model.qpos0, (1, 1)), ""
    if diagnosis.traces:
        trace = diagnosis.traces[0]
        poses = full_pose(model, diagnosis.joints, filled(trace.t, trace.recorded))
        error = np.nan_to_num(np.abs(trace.recorded - trace.before)).sum(axis=1)
        row = int(error.argmax())
        when = f", as recorded at {number(float(trace.t[row]))} s of {trace.name}"
        seen = poses[:: max(1, len(poses) // 40)]
    else:
        row, seen = 0, poses
    caption = f"The robot{when}." + (" The finding's place is marked." if marked else "")
    svg = draw(model, poses[row], marked, list(seen))
    return f"<figure>{svg}<figcaption>{html.escape(caption)}</figcaption></figure>"


def joint_order(diagnosis: Diagnosis) -> list[int]:
    """Columns of the joints, the worst error before first."""
    errors = diagnosis.proof.joints
    size = [errors[j].before if j in errors else -1.0 for j in diagnosis.joints]
    return sorted(range(len(size)), key=lambda j: -size[j])


def over_time(diagnosis: Diagnosis, trace: Trace) -> Iterator[str]:
    """Errors of the replays of one recording, a figure a joint."""
    first = diagnosis.recordings[0].path if diagnosis.recordings else trace.name
    spans = diagnosis.locations[0].intervals_s if diagnosis.locations else ()
    for j in joint_order(diagnosis):
        name = diagnosis.joints[j]
        before, after = (q[:, j] - trace.recorded[:, j] for q in (trace.before, trace.after))
        if not np.isfinite(before).any():
            continue
        factor, unit = scaled(float(np.nanmax(np.abs(before))), diagnosis.unit)
        error = diagnosis.proof.joints.get(name)
        rms = [np.sqrt(np.nanmean(e**2)) * factor for e in (before, after)]
        series = [Series("before", trace.t, before * factor)]
        said = f"Joint {name}: error RMS {number(float(rms[0]))} {unit}"
        if diagnosis.findings:
            series.append(Series("after", trace.t, after * factor))
            said += f" with the model as given, {number(float(rms[1]))} {unit} with the patched one"
        axes = Axes(
            x="time [s]",
            y=f"error of {name} [{unit}]",
            alt=f"{said}, over time in {trace.name}",
            spans=spans if trace.name == first else (),
            floor=2 * error.noise_floor * factor if error else None,
        )
        yield _figure(chart(series, axes), f"{said}.")


def shown_traces(diagnosis: Diagnosis) -> tuple[Trace, ...]:
    """What fits into a report: held-out recordings first."""
    order = sorted(diagnosis.traces, key=lambda t: t.role != "holdout")
    return tuple(order[:_MOST_TRACES])


def dependence(diagnosis: Diagnosis, finding: Finding, model: mujoco.MjModel | None) -> str:
    """The missing force over what a finding's law depends on; empty without traces."""
    column = _joint(diagnosis, finding.at, model)
    if not diagnosis.traces or column is None:
        return ""
    name = diagnosis.joints[column]
    variable, label, values = _variable(diagnosis, finding, column, model)
    slides = model is not None and model.joint(name).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    unit = "N" if slides else "N·m"
    x = np.concatenate(values)
    # a few extremes would squeeze all the rest
    low, high = np.nanquantile(x, [0.005, 0.995])
    x = np.where((x >= low) & (x <= high), x, np.nan)
    series = []
    for css in ("before", "after"):
        force = np.concatenate([getattr(t, f"force_{css}")[:, column] for t in diagnosis.traces])
        fine = np.isfinite(x) & np.isfinite(force)
        order = np.flatnonzero(fine)[np.random.default_rng(0).permutation(int(fine.sum()))]
        series.append(Series(css, x[order], force[order], "dots"))
        series.append(Series(css, *_binned(x[fine], force[fine]), "beads"))
    series = [series[0], series[2], series[1], series[3]]  # means lie on the clouds
    said = f"The force at joint {name} that the model leaves out, over {variable}"
    axes = Axes(x=label, y=f"missing force [{unit}]", alt=said)
    caption = f"{said}: dots are samples of all recordings, beads their means."
    return _figure(chart(series, axes), caption)


def horizon(diagnosis: Diagnosis) -> str:
    """RMSE over how far ahead replays look; empty if that was not measured."""
    h = diagnosis.proof.horizons
    if len(h) < 2:
        return ""
    x = np.array(sorted(h))
    both = np.array([h[s] for s in x.tolist()])
    factor, unit = scaled(float(np.nanmax(both)), diagnosis.unit)
    series = [Series("before", x, both[:, 0] * factor, "beads")]
    if diagnosis.findings:
        series.append(Series("after", x, both[:, 1] * factor, "beads"))
    said = "Error of replays that are restarted from the recording, over how far they look ahead"
    axes = Axes(x="seconds ahead", y=f"RMSE [{unit}]", alt=said, log=True)
    return _figure(chart(series, axes), f"{said}.")


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _joint(diagnosis: Diagnosis, at: Location, model: mujoco.MjModel | None) -> int | None:
    """The column at which a finding shows: its own joint, or where it took most force away."""
    name = at.name if at.kind == "joint" else None
    if model is not None and at.kind in ("joint", "actuator", "sensor", "pair"):
        name = joint_of(model, at)
    if name in diagnosis.joints:
        return diagnosis.joints.index(str(name))
    if not diagnosis.traces:
        return None
    taken = [
        np.nansum(t.force_before**2, axis=0) - np.nansum(t.force_after**2, axis=0)
        for t in diagnosis.traces
    ]
    return int(np.sum(taken, axis=0).argmax())


def _variable(
    diagnosis: Diagnosis, finding: Finding, column: int, model: mujoco.MjModel | None
) -> tuple[str, str, list[Array]]:
    """Name, label with unit, and values, one array a trace, of what the effect depends on."""
    traces, joint, unit = diagnosis.traces, diagnosis.joints[column], diagnosis.unit
    kind = "position"
    for kinds, said in (
        (_OVER_VELOCITY, "velocity"),
        (_OVER_ACCELERATION, "acceleration"),
        (_OVER_COMMAND, "command"),
        (_OVER_TIME, "time"),
    ):
        if any(part in finding.effect for part in kinds):
            kind = said
    if finding.depends_on:
        group, _, name = finding.depends_on[0].partition("/")
        kind = {"qvel": "velocity", "ctrl": "command", "t": "time"}.get(group, "position")
        if group in ("qpos", "qvel") and name in diagnosis.joints:
            joint, column = name, diagnosis.joints.index(name)
    command = _actuator(finding, joint, model)
    if kind == "command" and all(command in t.command for t in traces):
        return (
            f"the command of {command}",
            f"command of {command}",
            [t.command[command] for t in traces],
        )
    if kind == "time":
        return "time", "time [s]", [t.t for t in traces]
    if kind == "velocity":
        values = [t.velocity[:, column] for t in traces]
        return f"the velocity of {joint}", f"velocity of {joint} [{unit}/s]", values
    if kind == "acceleration":
        values = [np.gradient(t.velocity[:, column], t.t) for t in traces]
        return f"the acceleration of {joint}", f"acceleration of {joint} [{unit}/s²]", values
    values = [t.recorded[:, column] for t in traces]
    return f"the position of {joint}", f"position of {joint} [{unit}]", values


def _actuator(finding: Finding, joint: str, model: mujoco.MjModel | None) -> str:
    """The actuator whose command counts: the finding's own, or the one on its joint."""
    for column in finding.depends_on:
        if column.startswith("ctrl/"):
            return column.removeprefix("ctrl/")
    if finding.at.kind == "actuator":
        return finding.at.name
    if model is None:
        return ""
    for i in range(model.nactuator):
        name = str(model.actuator(i).name)
        if joint_of(model, Location("actuator", name)) == joint:
            return name
    return ""


def _binned(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of y in equal bins of x, leaving out thin bins."""
    if not x.size:
        return x, y
    edges = np.linspace(x.min(), x.max(), _BINS + 1)
    bins = np.digitize(x, edges) - 1
    means = [
        (x[bins == b].mean(), y[bins == b].mean())
        for b in range(_BINS)
        if (bins == b).sum() >= _LEAST
    ]
    found = np.array(means).reshape(-1, 2)
    return found[:, 0], found[:, 1]
