"""``trials.rrd``: the most telling cases of a trial, recorded and replayed side by side.

Each case is a row of three robots: as recorded, simulated with the model as given, and with the
patched one, on the held-out recording; all rows move at once on the timeline ``time`` [s].

===============================  ==========================================================
``world/<case> <robot>/<body>``  pose of a body
``error/<case>/<robot>``         simulated − recorded, root mean square over the joints
``summary``                      hidden effects and claims of each case
===============================  ==========================================================
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from wt.physics.quiet import quiet
from wt.prove import replay
from wt.prove.blind import inputs
from wt.prove.case_result import CaseResult
from wt.prove.folder import Folder
from wt.show import colors
from wt.show.robot_view import body_poses, log_robot, send_columns

COLORS: Mapping[str, colors.Color] = {
    "recorded": colors.R,
    "before": colors.BEFORE,
    "after": colors.AFTER,
}
_POSES_HZ, _LONGEST_S = 25.0, 12.0
_APART = 1.3  # in sizes of the largest robot


def telling(cases: Sequence[CaseResult], who: str) -> list[tuple[str, CaseResult]]:
    """The cases that say most, each with why: best, hardest, several, unknown, decoy, worst."""
    visible = [case for case in cases if case.truth and case.before_rmse > 0]
    right = [case for case in visible if case.marks(who).effect]
    outsiders = [case for case in right if case.kind == "outsider"]
    known = [case for case in right if case.kind != "outsider"]
    several = [case for case in right if len(case.truth) > 1]
    left = functools.partial(_left, who=who)
    groups: tuple[tuple[str, list[CaseResult], Callable[[CaseResult], float]], ...] = (
        ("explained best", known, left),
        ("smallest effect that was named", known, _size),
        ("several at once", several, left),
        ("outside the vocabulary", outsiders, left),
        ("decoy that was resisted", _resisted(cases, who), lambda case: -case.before_rmse),
        ("missed", _missed(visible, who), lambda case: -_size(case)),
        ("false alarm", _alarms(cases, who), lambda case: -case.before_rmse),
    )
    chosen: dict[str, tuple[str, CaseResult]] = {}
    for why, group, order in groups:
        rest = [case for case in group if case.id not in chosen]
        if rest:
            case = min(rest, key=order)
            chosen[case.id] = why, case
    return list(chosen.values())


def _left(case: CaseResult, who: str) -> float:
    """Share of the held-out error that a contender's model leaves."""
    return case.after_rmse[who] / case.before_rmse


def _size(case: CaseResult) -> float:
    """Visibility of the smallest hidden effect."""
    return min(visibility or np.inf for visibility in case.visibility)


def _missed(cases: Sequence[CaseResult], who: str) -> list[CaseResult]:
    """Cases without a claim at the hidden places."""
    return [case for case in cases if not case.marks(who).location]


def _resisted(cases: Sequence[CaseResult], who: str) -> list[CaseResult]:
    """Decoys without a false claim."""
    return [case for case in cases if case.decoy and not case.marks(who).false_claims]


def _alarms(cases: Sequence[CaseResult], who: str) -> list[CaseResult]:
    """Nulls with a false claim."""
    return [case for case in cases if case.kind == "null" and case.marks(who).false_claims]


@quiet()  # a patched model may explode
def film(folder: Folder, cases: Sequence[CaseResult], who: str) -> bytes:
    """The Rerun recording as bytes."""
    recording = rr.RecordingStream("wt prove", send_properties=False)
    memory = recording.memory_recording()
    chosen = telling(cases, who)
    width = max([_extent(folder.cases / case.id) for _, case in chosen], default=1.0)
    captions = []
    for place, (why, case) in enumerate(chosen):
        _log_case(recording, folder, case, who, place * _APART * width, _APART * width)
        hidden = ", ".join(f"{effect.law} at {effect.name}" for effect in case.truth) or "nothing"
        findings = case.contenders[who].findings
        claims = ", ".join(f"{f['effect']} at {f['at']['name']}" for f in findings) or "nothing"
        captions.append(f"**{case.name}** – {why}. Hidden: {hidden}. Said: {claims}.")
    text = rr.TextDocument("\n\n".join(captions), media_type=rr.MediaType.MARKDOWN)
    recording.log("summary", text, static=True, strict=True)
    recording.send_blueprint(
        rrb.Blueprint(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", name="robots"),
                rrb.Vertical(
                    rrb.TextDocumentView(origin="summary", name="cases"),
                    *(
                        rrb.TimeSeriesView(
                            origin=rr.new_entity_path(["error", case.name]), name=case.name
                        )
                        for _, case in chosen
                    ),
                ),
                column_shares=[3, 2],
            ),
            rrb.TimePanel(timeline="time", state="collapsed"),
        )
    )
    return bytes(memory.drain_as_bytes())


def _extent(case: Path) -> float:
    return float(mujoco.MjModel.from_xml_path(str(case / "robot.xml")).stat.extent)


def _log_case(
    recording: rr.RecordingStream,
    folder: Folder,
    result: CaseResult,
    who: str,
    y: float,
    apart: float,
) -> None:
    case, diagnosis = folder.cases / result.id, folder.said(who, result.id)
    given = mujoco.MjModel.from_xml_path(str(case / "robot.xml"))
    measured = replay.read(case / "robot.xml", inputs(case)[1][:1])[0]
    patched = given
    if (diagnosis / "model.xml").is_file():
        patched = mujoco.MjModel.from_xml_path(str(diagnosis / "model.xml"))
    paths = {
        "recorded": measured.q,
        "before": replay.replay(given, measured),
        "after": replay.replay(patched, measured),
    }
    step = max(1, round(1.0 / (_POSES_HZ * float(np.median(np.diff(measured.t))))))
    shown = measured.t <= _LONGEST_S
    t = measured.t[shown][::step]
    time = rr.TimeColumn("time", duration=t)
    for x, (robot, path) in enumerate(paths.items()):
        name = f"{result.name} {robot}"
        q = _poses(given, measured, path)[shown][::step]
        at = rr.Transform3D(translation=[apart * x, y, 0.0])
        recording.log(rr.new_entity_path(["world", name]), at, static=True, strict=True)
        log_robot(recording, given, time, name, body_poses(given, q), COLORS[robot])
        if robot != "recorded":
            squares = (path - measured.q)[shown][::step] ** 2
            led = np.isnan(squares).all(axis=1)
            error = np.sqrt(np.nanmean(squares[~led], axis=1))
            where = ["error", result.name, robot]
            style = rr.SeriesLines(colors=[COLORS[robot]], names=[robot])
            recording.log(rr.new_entity_path(where), style, static=True, strict=True)
            times = rr.TimeColumn("time", duration=t[~led])
            send_columns(recording, where, times, rr.Scalars.columns(scalars=error))


def _poses(
    model: mujoco.MjModel,
    measured: replay.HeldOutRecording,
    path: Float[np.ndarray, "sample joint"],
) -> Float[np.ndarray, "sample nq"]:
    """Generalised positions for joint positions, a trunk where it was measured."""
    poses = np.tile(model.qpos0, (len(path), 1))
    for joint, column in zip(measured.joints, path.T, strict=True):
        poses[:, model.joint(joint).qposadr[0]] = _filled(measured.t, column)
    if measured.base is not None:
        first = int(model.joint(measured.base.joint).qposadr[0])
        poses[:, first : first + 7] = measured.base.pose
    return poses


def _filled(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Missing samples between their neighbours; a robot of which nothing is known stands at 0."""
    known = np.isfinite(x)
    return np.interp(t, t[known], x[known]) if known.any() else np.zeros_like(t)
