"""The report's charts: errors over time, what a force depends on, and the horizon."""

from __future__ import annotations

import contextlib
import html
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from wt.diagnose.evidence import Trace
from wt.diagnose.report.drawing import draw, joint_of
from wt.diagnose.report.text import error as error_text
from wt.diagnose.report.text import name_of, number, scaled, short_name, tied
from wt.diagnose.result import Diagnosis, Finding
from wt.physics import base
from wt.physics.effect import effects
from wt.physics.scene import drives
from wt.physics.units import Units, command_unit
from wt.show.charts import Axes, Series, chart
from wt.types import Location

_BINS, _LEAST = 36, 5
_MOST_TRACES = 4
_MOST_SHADED = 0.8  # of a trace, from which shading tells nothing
_FADES = 1.5  # times as large as far ahead is an error of the start
_CHANGED = 0.02  # of what a force varies by, from which a patch takes something of it
_EXTREME = 0.005  # share of samples at either end that would squeeze all the rest
BEFORE = '<span class="key before">model as given</span>'
BEFORE_AFTER = f'{BEFORE} <span class="key after">patched model</span>'


def model_of(diagnosis: Diagnosis) -> mujoco.MjModel | None:
    """The model as given, free joints taken apart; None if its file is gone and it needs others."""
    # MuJoCo logs to a file of its own what is wrong with a path that does not exist
    path = Path(diagnosis.model_path)
    readers = [(mujoco.MjSpec.from_file, str(path))] if path.is_file() else []
    for read, text in (*readers, (mujoco.MjSpec.from_string, diagnosis.given_xml)):
        with contextlib.suppress(ValueError):
            spec = read(text)
            base.expand(spec)
            return spec.compile()
    return None


def full_pose(
    model: mujoco.MjModel, joints: Sequence[str], positions: Float[np.ndarray, "sample joint"]
) -> Float[np.ndarray, "sample position"]:
    """Generalised positions for those of the named joints; the rest at rest."""
    qpos = np.tile(model.qpos0, (len(positions), 1))
    for column, name in enumerate(joints):
        qpos[:, int(model.joint(name).qposadr[0])] = positions[:, column]
    return qpos


def filled(
    t: Float[np.ndarray, " sample"], values: Float[np.ndarray, "sample joint"]
) -> Float[np.ndarray, "sample joint"]:
    """Values, interpolated over time where they are not finite; zero where nothing is known."""
    out = np.array(values, float)
    for column in out.T:
        known = np.isfinite(column)
        column[~known] = np.interp(t[~known], t[known], column[known]) if known.any() else 0.0
    return out


def robot(diagnosis: Diagnosis, model: mujoco.MjModel) -> str:
    """The robot where its error is largest, with its culprits, as a figure."""
    marked: dict[Location, list[str]] = {}
    for f in diagnosis.findings:
        marked.setdefault(f.at, []).append(name_of(f.effect))
    if not marked and diagnosis.verdict != "no_mismatch":
        marked = {place.at: ["unexplained"] for place in diagnosis.locations[:1]}
    poses, when = np.tile(model.qpos0, (1, 1)), ""
    if diagnosis.traces:
        trace = diagnosis.traces[0]
        poses = full_pose(model, diagnosis.joints, filled(trace.t, trace.recorded))
        error = np.nan_to_num(np.abs(trace.recorded - trace.before)).sum(axis=1)
        row = int(error.argmax())
        name = short_name(diagnosis, trace.name)
        when = f", as recorded at {trace.t[row]:.1f} s of {name}, where the error is largest"
        seen = poses[:: max(1, len(poses) // 40)]
    else:
        row, seen = 0, poses
    what = "what was found" if diagnosis.findings else "the mismatch"
    caption = f"The robot{when}." + (f" Marked: where {what} acts." if marked else "")
    svg = draw(model, poses[row], marked, list(seen))
    return _figure(svg, caption)


def joint_order(diagnosis: Diagnosis) -> list[int]:
    """Columns of the joints, the worst error before first."""
    errors = diagnosis.proof.joints
    size = [errors[j].before if j in errors else -1.0 for j in diagnosis.joints]
    return sorted(range(len(size)), key=lambda j: -size[j])


def over_time(diagnosis: Diagnosis, trace: Trace) -> Iterator[str]:
    """Errors of the replays of one recording, a figure a joint."""
    for j in joint_order(diagnosis):
        name = diagnosis.joints[j]
        before, after = (q[:, j] - trace.recorded[:, j] for q in (trace.before, trace.after))
        if not np.isfinite(before).any():
            continue
        rms = [float(np.sqrt(np.nanmean(e**2))) for e in (before, after)]
        factor, unit = scaled(max(rms), diagnosis.unit_of(name))
        error = diagnosis.proof.joints.get(name)
        series = [Series("before", trace.t, before * factor)]
        caption = f"Joint {name}: error RMS {number(rms[0] * factor)} {unit}"
        if diagnosis.findings:
            series.append(Series("after", trace.t, after * factor))
            left = error_text(rms[1] * factor, error.noise_floor * factor if error else 0.0)
            caption += f" with the model as given, {left} {unit} with the patched one"
        axes = Axes(
            x="time [s]",
            y=f"error of {name} [{unit}]",
            alt=f"{caption}, over time in {trace.name}",
            spans=spans(diagnosis, trace),
            floor=2 * error.noise_floor * factor if error else None,
        )
        yield _figure(chart(series, axes), f"{caption}.")


def spans(diagnosis: Diagnosis, trace: Trace) -> tuple[tuple[float, float], ...]:
    """Intervals of the largest mismatch in a trace; empty if it is throughout, or in another."""
    first, last = float(trace.t[0]), float(trace.t[-1])
    intervals = tuple(
        (max(i.start, first), min(i.end, last))
        for i in (diagnosis.locations[0].intervals if diagnosis.locations else ())
        if i.recording == trace.name and i.end > first and i.start < last
    )
    covered = sum(end - start for start, end in intervals)
    return intervals if covered < _MOST_SHADED * (last - first) else ()


def shown_traces(diagnosis: Diagnosis) -> tuple[Trace, ...]:
    """As many traces as fit into a report: held-out recordings first."""
    order = sorted(diagnosis.traces, key=lambda t: t.role != "holdout")
    return tuple(order[:_MOST_TRACES])


def dependence(diagnosis: Diagnosis, finding: Finding, model: mujoco.MjModel | None) -> str:
    """The missing force over the variable of a finding's law; empty without traces."""
    column = _joint(diagnosis, finding.at, model)
    if not diagnosis.traces or column is None:
        return ""
    name = diagnosis.joints[column]
    variable, label, values = _variable(diagnosis, finding, column, model)
    unit = _units(diagnosis, name).force
    x = np.concatenate(values)
    x = _usual(x)
    series = []
    forces = [
        np.concatenate([f[:, column] for f in parts])
        for parts in zip(*((t.force_before, t.force_after) for t in diagnosis.traces), strict=True)
    ]
    before, after = forces
    known = effects().get(finding.effect)
    v = np.concatenate([t.velocity[:, column] for t in diagnosis.traces])
    ways = (v >= 0.0, v < 0.0) if known and known.each_way else (np.ones(len(v), bool),)
    # corrections within tolerance change it, too, by next to nothing
    changed = np.nanstd(after - before) > _CHANGED * np.nanstd(before)
    for css, force in zip(("before", "after"), (_usual(f) for f in forces), strict=True):
        if css == "after" and not changed:
            continue
        fine = np.isfinite(x) & np.isfinite(force)
        order = np.flatnonzero(fine)[np.random.default_rng(0).permutation(int(fine.sum()))]
        series.append(Series(css, x[order], force[order], "dots"))
        each = [fine & way for way in ways]
        series += [Series(css, *_binned(x[rows], force[rows]), "beads") for rows in each]
    series.sort(key=lambda s: s.mark == "beads")  # means lie on the clouds
    title = f"The force at joint {name} that the model leaves out, over {variable}"
    axes = Axes(x=label, y=f"missing force [{unit}]", alt=title)
    caption = f"{title}: dots are samples of all recordings, beads their means"
    caption += ", on the way there and on the way back." if len(ways) > 1 else "."
    if not (changed or finding.lawless):
        caption += " What the finding takes of it shows in replays alone."
    return _figure(chart(series, axes), caption)


def horizons(diagnosis: Diagnosis) -> str:
    """RMSE over how far ahead replays look, a chart a unit; empty if that was not measured."""
    measured = diagnosis.proof.horizons.items()
    return "".join(_horizon(diagnosis, unit, ahead) for unit, ahead in measured if len(ahead) > 1)


def _horizon(diagnosis: Diagnosis, unit: str, ahead: Mapping[float, tuple[float, float]]) -> str:
    x = np.array(sorted(ahead))
    both = np.array([ahead[s] for s in x.tolist()])
    noise = [
        error.noise_floor
        for joint, error in diagnosis.proof.joints.items()
        if diagnosis.unit_of(joint) == unit
    ]
    factor, shown = scaled(float(np.nanmax(both)), unit)
    series = [Series("before", x, both[:, 0] * factor, "beads")]
    if diagnosis.findings:
        series.append(Series("after", x, both[:, 1] * factor, "beads"))
    title = "Error of replays that are restarted from the recording, over how far they look ahead"
    if len(diagnosis.proof.horizons) > 1:
        title += f", of positions in {unit}"
    axes = Axes(x="how far ahead [s]", y=f"RMSE [{shown}]", alt=title, log=True)
    floor = float(np.sqrt(np.mean(np.square(noise)))) if noise else 0.0
    said = _worse_ahead(ahead, 2.0 * floor, factor, shown) if diagnosis.findings else ""
    if diagnosis.findings and both[0, 1] > _FADES * both[-1, 1]:
        said += (
            " A restart does not know what no recording tells, such as the side on which play is; "
            "that fades."
        )
    return _figure(chart(series, axes), f"{title}.{said}")


def _worse_ahead(
    ahead: Mapping[float, tuple[float, float]], noise: float, factor: float, unit: str
) -> str:
    """A sentence where the patched model is worse at some horizon: the verdict is not all then.

    Errors within noise say nothing about either model.
    """
    worse = {s: (b, a) for s, (b, a) in sorted(ahead.items()) if a > max(b, noise)}
    if not worse:
        return ""
    said = ", ".join(
        f"{number(after * factor)} against {number(before * factor)} {unit} at {s:g} s"
        for s, (before, after) in worse.items()
    )
    return f" So far ahead the patched model is worse than the one given: {said}."


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{html.escape(tied(caption))}</figcaption></figure>"


def _usual(values: Float[np.ndarray, " value"]) -> Float[np.ndarray, " value"]:
    """Values with the extreme ones left out, as NaN."""
    low, high = np.nanquantile(values, [_EXTREME, 1.0 - _EXTREME])
    return np.where((values >= low) & (values <= high), values, np.nan)


def _joint(diagnosis: Diagnosis, at: Location, model: mujoco.MjModel | None) -> int | None:
    """The column at which a finding shows: its own joint, or where it took most force away."""
    name = at.name if at.kind == "joint" else None
    if model is not None and at.kind in ("joint", "actuator", "sensor", "pair"):
        name = joint_of(model, at)
    if name in diagnosis.joints:
        return diagnosis.joints.index(str(name))
    if not diagnosis.traces:
        return None
    each = [
        np.nansum(t.force_before**2, axis=0) - np.nansum(t.force_after**2, axis=0)
        for t in diagnosis.traces
    ]
    taken = np.sum(each, axis=0)
    if model is not None and at.kind == "actuator":  # of all drives, not of what floats
        driven = {drive.joint for drive in drives(model)}
        taken = np.where([joint in driven for joint in diagnosis.joints], taken, -np.inf)
    return int(taken.argmax())


def _variable(
    diagnosis: Diagnosis, finding: Finding, column: int, model: mujoco.MjModel | None
) -> tuple[str, str, list[Float[np.ndarray, " _"]]]:
    """The variable that an effect depends on: name, label with unit, and values of each trace."""
    traces = diagnosis.traces
    kind, column = _depends(diagnosis, finding, column)
    joint = diagnosis.joints[column]
    unit = diagnosis.unit_of(joint)
    command = _actuator(finding, joint, model)
    if kind in ("command", "drive") and all(command in t.command for t in traces):
        if kind == "command" or model is None:
            values = [t.command[command] for t in traces]
            of_command = command_unit(model, command, _units(diagnosis, joint)) if model else "-"
            said = f"command of {command} [{of_command}]"
            return f"the command of {command}", said, values
        label = f"force of {command} in the model"
        values = _drive_forces(diagnosis, model, command, column)
        return f"the {label}", f"{label} [{_units(diagnosis, joint).force}]", values
    if kind == "time":
        return "time", "time [s]", [t.t for t in traces]
    if kind == "velocity":
        per, values = "/s", [t.velocity[:, column] for t in traces]
    elif kind == "acceleration":
        per, values = "/s²", [np.gradient(t.velocity[:, column], t.t) for t in traces]
    else:
        kind, per, values = "position", "", [t.recorded[:, column] for t in traces]
    return f"the {kind} of {joint}", f"{kind} of {joint} [{unit}{per}]", values


def _drive_forces(
    diagnosis: Diagnosis, model: mujoco.MjModel, actuator: str, column: int
) -> list[Float[np.ndarray, " _"]]:
    """Forces of the model's drive at the recorded commands and motion, one array a trace."""
    drive = next(d for d in drives(model) if d.name == actuator)
    return [
        drive.force(t.command[actuator], t.recorded[:, column], t.velocity[:, column])
        for t in diagnosis.traces
    ]


def _depends(diagnosis: Diagnosis, finding: Finding, column: int) -> tuple[str, int]:
    """Kind of the variable that an effect depends on, and the column of its joint."""
    if not finding.depends_on:
        known = effects().get(finding.effect)
        return (known.plotted_over if known else "position"), column
    group, _, name = finding.depends_on[0].partition("/")
    if group in ("qpos", "qvel") and name in diagnosis.joints:
        column = diagnosis.joints.index(name)
    kinds = {"qvel": "velocity", "ctrl": "command", "t": "time"}
    return kinds.get(group, "position"), column


def _units(diagnosis: Diagnosis, joint: str) -> Units:
    return Units(slide=diagnosis.unit_of(joint) == "m")


def _actuator(finding: Finding, joint: str, model: mujoco.MjModel | None) -> str:
    """The actuator whose command counts: the finding's own, or the one on its joint."""
    for column in finding.depends_on:
        if column.startswith("ctrl/"):
            return column.removeprefix("ctrl/")
    if finding.at.kind == "actuator" and finding.at.name != "all":
        return finding.at.name
    if model is None:
        return ""
    for i in range(model.nactuator):
        name = str(model.actuator(i).name)
        if joint_of(model, Location("actuator", name)) == joint:
            return name
    return ""


def _binned(
    x: Float[np.ndarray, " sample"], y: Float[np.ndarray, " sample"]
) -> tuple[Float[np.ndarray, " bin"], Float[np.ndarray, " bin"]]:
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
    beads = np.array(means).reshape(-1, 2)
    return beads[:, 0], beads[:, 1]
