"""Fleets: what is drawn, what is written, and the marks of a passport."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wt.data import recording as recordings
from wt.data.labels import Labels
from wt.errors import WorkError
from wt.passport import folder as passports
from wt.passport.estimates import GroupEstimate, Quantity
from wt.passport.folder import Addition
from wt.prove import fleet
from wt.prove.answer import from_json
from wt.prove.case_result import CaseResult, ContenderResult
from wt.prove.fleet_marks import FleetMarks, mark_fleet
from wt.prove.page import page
from wt.prove.results import summary
from wt.prove.score import CaseScore
from wt.prove.tally import scores

HINGE, ELBOW = "joint.friction_coulomb/hinge/coulomb", "actuator.gain/elbow_drive/factor"
HIDDEN = {
    "levels": {HINGE: "model", ELBOW: "session"},
    "change": {"quantity": HINGE, "unit": "U01", "session": 2, "by": 0.1},
    "units": 2,
    "sessions": 4,
}


@pytest.mark.parametrize("seed", range(6))
def test_levels_are_what_they_are_called(seed: int) -> None:
    drawn = fleet.fleets(seed)
    assert [c.changed for c in drawn] == [c.changed for c in fleet.fleets(seed)]
    for case in drawn:
        which, unit, since = case.changed
        for k, trait in enumerate(case.traits):
            sizes = trait.sizes.copy()
            if k == which:
                before, after = sizes[unit, :since], sizes[unit, since:]
                assert np.ptp(before) == np.ptp(after) == 0.0
                assert after[0] == pytest.approx(1.8 * before[0])
                sizes[unit, since:] = before[0]
            over_sessions = np.ptp(sizes, axis=1).max() > 0
            over_units = np.ptp(sizes[:, 0]) > 0
            assert trait.level == {
                (False, False): "model", (True, False): "unit", (True, True): "session",
            }[over_units, over_sessions]  # fmt: skip
        assert {trait.level for trait in case.traits} == {"model", "unit", "session"}
        assert len({trait.quantity for trait in case.traits}) == 3


def test_recordings_are_labelled_and_say_no_more(tmp_path: Path) -> None:
    case = fleet.fleets(1, units=2, sessions=3)[0]
    answer = fleet.write_files(case, tmp_path)
    paths = sorted(tmp_path.glob("fit-*.parquet"))
    assert len(paths) == 6
    labels = {(m["unit"], m["session"]) for m in (recordings.read(p).meta for p in paths)}
    assert len(labels) == 6
    assert all(
        set(recordings.read(p).meta) == {"robot", "source", "unit", "session"} for p in paths
    )
    assert answer.fleet["levels"] == {t.quantity: t.level for t in case.traits}
    assert answer.fleet["change"]["session"] == case.changed[2]
    assert from_json(json.loads(json.dumps(answer.to_json())), "x") == answer
    # another session of one unit is another motion of the same machine
    q = [recordings.read(p).columns["qpos/crank"] for p in paths[:2]]
    assert np.abs(q[0] - q[1]).max() > 0.1


def said(folder: Path, alarms: list[list[tuple[str, str]]], levels: dict[str, str]) -> Path:
    """A passport with these additions."""
    folder.mkdir(exist_ok=True)
    labels = Labels("U01", "2026-03-01")
    quantity = Quantity("joint.friction_coulomb", "joint", "hinge", "coulomb", "N·m")
    rows = (GroupEstimate(labels, quantity, 0.3, 0.02, 0.0, ""),)
    for of in alarms:
        decided = {
            "alarms": [{"unit": u, "quantity": q} for u, q in of],
            "levels": [{"quantity": q, "level": level} for q, level in levels.items()],
        }
        passports.append(folder, Addition("m.xml", "ab", "2026-03-01", (), (), rows, decided))
    return folder


def test_marks_of_a_passport(tmp_path: Path) -> None:
    right, other = ("U01", HINGE), ("U00", ELBOW)
    levels = {HINGE: "unit", ELBOW: "session"}
    marks = mark_fleet(said(tmp_path, [[], [right, other], [], [right, other]], levels), HIDDEN)
    # what changed before the last session has no level
    assert marks.levels == {ELBOW: ("session", "session")}
    assert marks.errors == pytest.approx(5.0)
    assert marks.after == 1 and marks.noticed
    # both alarms of the second session were before the change
    assert (marks.false_alarms, marks.unit_sessions) == (3, 8)
    assert FleetMarks.from_json(json.loads(json.dumps(marks.to_json()))) == marks


def test_a_change_that_is_told_late_or_never_was_not_noticed(tmp_path: Path) -> None:
    early = {**HIDDEN, "change": {**HIDDEN["change"], "session": 1}}  # type: ignore[dict-item]
    folder = said(tmp_path, [[], [], [], [("U01", HINGE)]], {})
    assert mark_fleet(folder, early).after == 2
    assert not mark_fleet(folder, early).noticed
    assert mark_fleet(folder, {**HIDDEN, "units": 3}).levels == {ELBOW: ("session", "")}
    assert mark_fleet(said(tmp_path / "silent", [[], [], [], []], {}), HIDDEN).after is None
    said(folder, [[]], {})
    with pytest.raises(WorkError, match="more additions than there were sessions"):
        mark_fleet(folder, HIDDEN)


def test_nothing_said_is_nothing_right(tmp_path: Path) -> None:
    marks = mark_fleet(tmp_path, HIDDEN)
    assert marks.levels == {ELBOW: ("session", "")}
    assert (marks.errors, marks.after, marks.false_alarms) == (0.0, None, 0)


def test_scores_of_fleets() -> None:
    marks = [
        FleetMarks({HINGE: ("model", "model"), ELBOW: ("session", "unit")}, 5.0, 1, 1, 72),
        FleetMarks({HINGE: ("unit", "unit")}, 2.0, None, 0, 72),
    ]
    results = [
        CaseResult(
            str(k), str(k), "fleet", "arm3", "", "", (), (), None, np.nan, "", np.nan,
            {"passport": ContenderResult(1.0, "", (), CaseScore(None, None, None, 0), fleet=m)},
            {"passport": np.nan},
        )
        for k, m in enumerate(marks)
    ]  # fmt: skip
    found = scores(results, "passport")
    assert (found["levels"]["right"], found["levels"]["of"]) == (2, 3)
    # a change of two standard errors need not be seen
    assert (found["changes"]["right"], found["changes"]["of"]) == (1, 1)
    assert (found["false_changes"]["right"], found["false_changes"]["of"]) == (1, 144)
    assert found["false_alarms"]["of"] == 0
    trial = {
        "set": "fleet", "seed": 1, "guard": "audit", "code": "abc", "code_changed": False,
        **summary(results, ("passport",)), "cases": [case.to_json() for case in results],
    }  # fmt: skip
    shown = page(json.loads(json.dumps(trial)))
    assert all(text in shown for text in ("wt passport", "fleets: right level", ">67"))
