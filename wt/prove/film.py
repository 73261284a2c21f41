"""``trials.rrd``: the most telling cases of a trial, recorded and replayed side by side.

Each case is a row of three robots: as recorded, simulated with the model as given, and with the
patched one, on the held-out recording; all rows move at once on the timeline ``time`` [s].

===============================  ==========================================================
``world/<case> <robot>/<body>``  pose of a body
``error/<case>/<robot>``         simulated − recorded, root mean square over the joints
``summary``                      what was hidden in each case, and what was said
===============================  ==========================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from wt.physics.quiet import quiet
from wt.prove import replay
from wt.prove.blind import inputs
from wt.prove.folder import Folder
from wt.prove.marks import Row
from wt.show import colors
from wt.show.robot_view import log_robot, motion_of, send_columns

COLORS: Mapping[str, colors.Color] = {
    "recorded": colors.R,
    "before": colors.BEFORE,
    "after": colors.AFTER,
}
_POSES_HZ, _LONGEST_S = 25.0, 12.0
_APART = 1.3  # in sizes of the largest robot


def telling(rows: Sequence[Row], who: str) -> list[tuple[str, Row]]:
    """The cases that say most, each with why: best, hardest, several, unknown, decoy, worst."""
    visible = [row for row in rows if row["truth"] and row["before_rmse"]]

    def marks(row: Row) -> Mapping[str, Any]:
        found: Mapping[str, Any] = row["said"][who]["marks"]
        return found

    def left(row: Row) -> float:
        return float(row["after_rmse"][who]) / float(row["before_rmse"])

    right = [row for row in visible if marks(row)["effect"]]
    wrong = [row for row in visible if not marks(row)["location"]]
    false = [row for row in rows if row["kind"] == "null" and marks(row)["false_claims"]]
    silent = [row for row in rows if row["decoy"] and not marks(row)["false_claims"]]
    several = [row for row in right if len(row["truth"]) > 1]
    outside = [row for row in right if row["kind"] == "outsider"]
    known = [row for row in right if row["kind"] != "outsider"]
    found: list[tuple[str, Row]] = []
    for why, some, size in (
        ("explained best", known, left),
        ("smallest effect that was named", known, _size),
        ("several at once", several, left),
        ("outside the vocabulary", outside, left),
        ("decoy that was resisted", silent, lambda row: -float(row["before_rmse"])),
        ("missed", wrong, lambda row: -_size(row)),
        ("false alarm", false, lambda row: -float(row["before_rmse"])),
    ):
        left_over = [row for row in some if row["id"] not in {r["id"] for _, r in found}]
        if left_over:
            found.append((why, min(left_over, key=size)))
    return found


def _size(row: Row) -> float:
    return min(truth["visibility"] or np.inf for truth in row["truth"])


@quiet()  # a patched model may explode
def film(folder: Folder, rows: Sequence[Row], who: str) -> bytes:
    """The Rerun recording as bytes."""
    recording = rr.RecordingStream("wt prove", send_properties=False)
    memory = recording.memory_recording()
    chosen = telling(rows, who)
    width = max([_extent(folder.cases / row["id"]) for _, row in chosen], default=1.0)
    said = []
    for place, (why, row) in enumerate(chosen):
        _log_case(recording, folder, row, who, place * _APART * width, _APART * width)
        hidden = ", ".join(f"{t['law']} at {t['at']['name']}" for t in row["truth"]) or "nothing"
        findings = row["said"][who]["findings"]
        answer = ", ".join(f"{f['effect']} at {f['at']['name']}" for f in findings) or "nothing"
        said.append(f"**{row['name']}** – {why}. Hidden: {hidden}. Said: {answer}.")
    text = rr.TextDocument("\n\n".join(said), media_type=rr.MediaType.MARKDOWN)
    recording.log("summary", text, static=True, strict=True)
    recording.send_blueprint(
        rrb.Blueprint(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", name="robots"),
                rrb.Vertical(
                    rrb.TextDocumentView(origin="summary", name="cases"),
                    *(
                        rrb.TimeSeriesView(
                            origin=rr.new_entity_path(["error", row["name"]]), name=row["name"]
                        )
                        for _, row in chosen
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
    recording: rr.RecordingStream, folder: Folder, row: Row, who: str, y: float, apart: float
) -> None:
    case, said = folder.cases / row["id"], folder.said(who, row["id"])
    given = mujoco.MjModel.from_xml_path(str(case / "robot.xml"))
    measured = replay.read(case / "robot.xml", inputs(case)[1][:1])[0]
    patched = given
    if (said / "model.xml").is_file():
        patched = mujoco.MjModel.from_xml_path(str(said / "model.xml"))
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
        name = f"{row['name']} {robot}"
        q = _poses(given, measured, path)[shown][::step]
        at = rr.Transform3D(translation=[apart * x, y, 0.0])
        recording.log(rr.new_entity_path(["world", name]), at, static=True, strict=True)
        log_robot(recording, given, time, name, motion_of(given, q), COLORS[robot])
        if robot != "recorded":
            squares = (path - measured.q)[shown][::step] ** 2
            led = np.isnan(squares).all(axis=1)
            error = np.sqrt(np.nanmean(squares[~led], axis=1))
            where = ["error", row["name"], robot]
            style = rr.SeriesLines(colors=[COLORS[robot]], names=[robot])
            recording.log(rr.new_entity_path(where), style, static=True, strict=True)
            times = rr.TimeColumn("time", duration=t[~led])
            send_columns(recording, where, times, rr.Scalars.columns(scalars=error))


def _poses(
    model: mujoco.MjModel,
    measured: replay.HeldOutRecording,
    path: Float[np.ndarray, "sample joint"],
) -> Float[np.ndarray, "sample nq"]:
    """Generalised positions for joint positions (N, joints), a trunk where it was measured."""
    found = np.tile(model.qpos0, (len(path), 1))
    for joint, column in zip(measured.joints, path.T, strict=True):
        found[:, model.joint(joint).qposadr[0]] = _filled(measured.t, column)
    if measured.base is not None:
        first = int(model.joint(measured.base.joint).qposadr[0])
        found[:, first : first + 7] = measured.base.pose
    return found


def _filled(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Missing samples between their neighbours; a robot of which nothing is known stands at 0."""
    known = np.isfinite(x)
    return np.interp(t, t[known], x[known]) if known.any() else np.zeros_like(t)
