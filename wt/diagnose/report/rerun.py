"""``diagnosis.rrd``: the robot as recorded and as simulated before and after, moving together.

Entities, all on the timeline ``time`` [s], on which the recordings follow each other, held-out ones
first, with a pause between them:

=======================================  ======================================================
``world/<robot>/<body>``                 pose of a body; each of its geoms lies below it, static
``position/<joint>/<robot>``             joint positions
``error/<joint>/<robot>``                simulated − recorded
``force/<joint>/<before or after>``      generalised force that the model lacks
``log``                                  which recording begins, and where the mismatch acts
``summary``                              the findings in words
=======================================  ======================================================

The robots are ``recorded``, ``before`` and ``after``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from wt.diagnose.evidence import Trace
from wt.diagnose.report import text
from wt.diagnose.report.charts import filled, full_pose, joint_order, model_of
from wt.diagnose.result import Diagnosis
from wt.show import colors
from wt.show.robot_view import BodyPoses, body_poses, log_robot, send_columns

RECORDED, BEFORE, AFTER = "recorded", "before", "after"
COLORS: Mapping[str, colors.Color] = {
    RECORDED: colors.R,
    BEFORE: colors.BEFORE,
    AFTER: colors.AFTER,
}
PAUSE_S = 1.0
_POSES_HZ, _SERIES_HZ = 25.0, 50.0
_MOST_S = 180.0
_MOST_JOINTS = 8
_GAP = 0.35  # of the model's size, between neighbouring robots


@dataclass(frozen=True, eq=False)
class Film:
    """All traces after each other.

    Attributes:
        starts: begin of each trace on the timeline [s].
        traces: the traces, held-out ones first.
    """

    starts: tuple[float, ...]
    traces: tuple[Trace, ...]

    def joined(
        self, rate: float, values: Sequence[Float[np.ndarray, "_ ..."]]
    ) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, "time ..."]]:
        """Time on the timeline and values of all traces, thinned to about ``rate`` [Hz]."""
        times, kept = [], []
        for start, trace, value in zip(self.starts, self.traces, values, strict=True):
            step = max(1, round(1.0 / (rate * float(np.median(np.diff(trace.t))))))
            times.append(start + trace.t[::step] - trace.t[0])
            kept.append(value[::step])
        return np.concatenate(times), np.concatenate(kept)


def playback(diagnosis: Diagnosis) -> bytes:
    """The recording as bytes; without traces only the words are in it."""
    recording = rr.RecordingStream("wt diagnose", send_properties=False)
    memory = recording.memory_recording()
    film, model = _film(diagnosis), model_of(diagnosis)
    sentences = [*text.sentences(diagnosis), text.fit(diagnosis), *diagnosis.notes]
    summary = rr.TextDocument("\n\n".join(sentences), media_type=rr.MediaType.MARKDOWN)
    recording.log("summary", summary, static=True, strict=True)
    motions: dict[str, BodyPoses] = {}
    if film.traces:
        if model is not None:
            motions = _log_robots(recording, diagnosis, film, model)
        _log_series(recording, diagnosis, film)
        _log_events(recording, diagnosis, film)
    recording.send_blueprint(_blueprint(diagnosis, motions))
    return bytes(memory.drain_as_bytes())


def _film(diagnosis: Diagnosis) -> Film:
    chosen: list[Trace] = []
    starts: list[float] = []
    end = 0.0
    for trace in sorted(diagnosis.traces, key=lambda t: t.role != "holdout"):
        if end > _MOST_S or len(trace.t) < 2:
            continue
        chosen.append(trace)
        starts.append(end)
        end += float(trace.t[-1] - trace.t[0]) + PAUSE_S
    return Film(tuple(starts), tuple(chosen))


def _positions(trace: Trace, robot: str) -> Float[np.ndarray, "sample joint"]:
    return {RECORDED: trace.recorded, BEFORE: trace.before, AFTER: trace.after}[robot]


def _log_robots(
    recording: rr.RecordingStream, diagnosis: Diagnosis, film: Film, model: mujoco.MjModel
) -> dict[str, BodyPoses]:
    """Three robots side by side, the recorded one leftmost."""
    motions, time = {}, np.zeros(0)
    for robot in _robots(diagnosis):
        full = [filled(t.t, _positions(t, robot)) for t in film.traces]
        time, positions = film.joined(_POSES_HZ, full)
        motions[robot] = body_poses(model, full_pose(model, diagnosis.joints, positions))
    along, _ = _directions(motions)
    places = np.concatenate([m.pos[:, 1:].reshape(-1, 3) for m in motions.values()]) @ along
    apart = float(np.ptp(places)) + _GAP * model.stat.extent
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    for place, (robot, motion) in enumerate(motions.items()):
        shift = apart * (place - (len(motions) - 1) / 2) * along
        at = rr.Transform3D(translation=shift)
        recording.log(rr.new_entity_path(["world", robot]), at, static=True, strict=True)
        column = rr.TimeColumn("time", duration=time)
        log_robot(recording, model, column, robot, motion, COLORS[robot])
    return motions


def _robots(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Without findings, before and after are the same."""
    return (RECORDED, BEFORE, AFTER) if diagnosis.findings else (RECORDED, BEFORE)


def _log_series(recording: rr.RecordingStream, diagnosis: Diagnosis, film: Film) -> None:
    robots = _robots(diagnosis)
    for j, joint in enumerate(diagnosis.joints):
        for robot in robots:
            path = [joint, robot]
            values = [_positions(t, robot)[:, j] for t in film.traces]
            _send(recording, film, ["position", *path], values, COLORS[robot])
            if robot == RECORDED:
                continue
            errors = [_positions(t, robot)[:, j] - t.recorded[:, j] for t in film.traces]
            _send(recording, film, ["error", *path], errors, COLORS[robot])
            forces = [
                (t.force_before if robot == BEFORE else t.force_after)[:, j] for t in film.traces
            ]
            _send(recording, film, ["force", *path], forces, COLORS[robot])


def _send(
    recording: rr.RecordingStream,
    film: Film,
    path: list[str],
    values: Sequence[Float[np.ndarray, " _"]],
    color: colors.Color,
) -> None:
    time, joined = film.joined(_SERIES_HZ, values)
    # a NaN between two recordings keeps the viewer from drawing a line across
    pauses = np.array(film.starts[1:]) - PAUSE_S / 2
    at = np.searchsorted(time, pauses)
    fine = np.insert(np.isfinite(joined), at, True)
    time, joined = np.insert(time, at, pauses), np.insert(joined, at, np.nan)
    style = rr.SeriesLines(colors=[color], widths=[1.5], names=[path[-1]])
    recording.log(rr.new_entity_path(path), style, static=True, strict=True)
    columns = rr.Scalars.columns(scalars=joined[fine])
    send_columns(recording, path, rr.TimeColumn("time", duration=time[fine]), columns)


def _log_events(recording: rr.RecordingStream, diagnosis: Diagnosis, film: Film) -> None:
    """Beginnings of recordings, and the intervals of places in them, in order of time."""
    events: list[tuple[float, str, rr.TextLogLevel]] = []
    for start, trace in zip(film.starts, film.traces, strict=True):
        role = "held out" if trace.role == "holdout" else "fitted"
        events.append((start, f"{trace.name}, {role}", rr.TextLogLevel.INFO))
        shift = start - float(trace.t[0])
        for place in diagnosis.locations:
            for i in place.intervals:
                if i.recording == trace.name and trace.t[0] <= i.start <= trace.t[-1]:
                    until = f"until {text.number(shift + i.end)} s"
                    words = " ".join(filter(None, [str(place.at), place.condition, until]))
                    events.append((shift + i.start, words, rr.TextLogLevel.WARN))
    for when, words, level in sorted(events, key=lambda e: e[0]):
        recording.set_time("time", duration=when)
        recording.log("log", rr.TextLog(words, level=level), strict=True)


def _blueprint(diagnosis: Diagnosis, motions: Mapping[str, BodyPoses]) -> rrb.Blueprint:
    """Robots and events at the left; at the right one tab a joint, the worst first."""
    tabs = [
        rrb.Vertical(
            *(
                rrb.TimeSeriesView(
                    origin=rr.new_entity_path([group, joint]),
                    name=f"{group} of {joint}",
                    plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=group == "position"),
                )
                for group in ("error", "position", "force")
            ),
            name=joint,
        )
        for joint in (diagnosis.joints[j] for j in joint_order(diagnosis)[:_MOST_JOINTS])
    ]
    words_ = rrb.Horizontal(
        rrb.TextDocumentView(origin="summary", name="findings"),
        rrb.TextLogView(origin="log", name="events"),
    )
    left = rrb.Vertical(_scene(motions), words_, row_shares=[3, 1]) if motions else words_
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Tabs(*tabs), column_shares=[3, 2]),
        rrb.TimePanel(timeline="time", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _directions(
    motions: Mapping[str, BodyPoses],
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Horizontal unit vectors: along which robots stand, and towards who sees most motion."""
    moving = np.concatenate([m.pos[:, 1:, :2].reshape(-1, 2) for m in motions.values()])
    _, vectors = np.linalg.eigh(np.cov(moving.T, bias=True) + 1e-12 * np.diag([0.0, 1.0]))
    x, y = vectors[:, 0] if vectors[0, 0] > 0 or vectors[1, 0] < 0 else -vectors[:, 0]
    return np.array([-y, x, 0.0]), np.array([x, y, 0.0])


def _scene(motions: Mapping[str, BodyPoses]) -> rrb.Spatial3DView:
    along, towards = _directions(motions)
    points = np.concatenate([motion.pos[:, 1:].reshape(-1, 3) for motion in motions.values()])
    low, high = points.min(axis=0), points.max(axis=0)
    center = (low + high) / 2
    width = len(motions) * (
        float(np.ptp(points @ along)) + 0.5 * max(m.reach for m in motions.values())
    )
    distance = 0.8 * max(width, 1.5 * float(high[2] - low[2]), 0.1)
    eye = rrb.EyeControls3D(
        position=center + distance * (towards + np.array([0.0, 0.0, 0.35])),
        look_target=center,
        eye_up=[0.0, 0.0, 1.0],
    )
    return rrb.Spatial3DView(origin="world", name="robots", eye_controls=eye)
