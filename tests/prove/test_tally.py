"""Scores from results written by hand."""

from __future__ import annotations

import math

import pytest

from wt.prove import tally
from wt.prove.case import HiddenEffect
from wt.prove.case_result import CaseResult, ContenderResult
from wt.prove.score import CaseScore

WHO = "diagnose"


def result(
    kind: str = "single",
    hidden: tuple[tuple[str, float | None], ...] = (),
    said: tuple[str, ...] = (),
    false: int = 0,
    error: str = "",
    off: tuple[float, ...] = (),
    after: float = 0.1,
) -> CaseResult:
    """A case: hidden laws with their sizes, and what was said at their places."""
    marks = CaseScore(
        location=None,
        effect=None,
        effect_top_or_confusable=None if kind == "null" else True,
        false_claims=false,
        errors={"p": 0.1} if off else {},
        said=said,
        off={f"p{i}": distance for i, distance in enumerate(off)},
    )
    findings = ({"effect": "joint.stop"},) * false
    return CaseResult(
        id="case", name="case", kind=kind, rig="arm", decoy="", level="",
        truth=tuple(
            HiddenEffect("unknown" if law.startswith("outsider") else law, "joint", "j", {}, law)
            for law, _ in hidden
        ),
        visibility=tuple(size for _, size in hidden),
        noise_rms=0.05,
        published_rmse=math.nan,
        known="",
        before_rmse=0.2,
        contenders={WHO: ContenderResult(60.0, error, findings, marks)},
        after_rmse={WHO: after},
    )  # fmt: skip


DRY, PLAY, MAGNET = "joint.friction_coulomb", "joint.backlash", "outsider.detent"
RESULTS = [
    result(hidden=((DRY, 20.0),), said=(DRY,), off=(0.5,)),
    result(hidden=((DRY, 4.0),), said=("joint.stop",), false=1),
    result(
        "pair", hidden=((DRY, 9.0), (PLAY, 8.0)), said=(DRY, ""), off=(-2.5, math.inf), after=0.3
    ),
    result(hidden=((PLAY, 0.5),), said=("",)),
    result("outsider", hidden=((MAGNET, 12.0),), said=("unknown",)),
    result("outsider", hidden=((MAGNET, None),), said=(DRY,), after=0.4),
    result("null"),
    result("null", false=2),
    result("null", error="ended after 9 s"),
]


def test_shares() -> None:
    found = tally.scores(RESULTS, WHO)
    # six visible effects, one of them not found; nobody can find the one below the noise
    assert (found["location"]["right"], found["location"]["of"]) == (5, 6)
    assert (found["location_of_all"]["right"], found["location_of_all"]["of"]) == (5, 7)
    assert (found["effect"]["right"], found["effect"]["of"]) == (2, 4)
    assert (found["unknown"]["right"], found["unknown"]["of"]) == (1, 2)
    assert (found["unknown_place"]["right"], found["unknown_place"]["of"]) == (2, 2)
    # an error is not silence
    assert (found["false_alarms"]["right"], found["false_alarms"]["of"]) == (2, 3)
    assert (found["extra_claims"]["right"], found["extra_claims"]["of"]) == (1, 6)
    assert (found["coverage"]["right"], found["coverage"]["of"]) == (1, 3)
    assert found["errors"] == 1
    # held-out errors of what MJCF can express and anybody can see
    assert found["error_left"] == pytest.approx(0.5)
    assert found["error_over_noise"] == pytest.approx(2.0)
    assert (found["improved"]["right"], found["improved"]["of"]) == (2, 3)


def test_intervals_of_shares_are_wilsons() -> None:
    # Newcombe (1998), table I: 81 of 263 has the interval 0.2553 … 0.3662
    assert tally.share([True] * 81 + [False] * 182)["ci95"] == pytest.approx(
        [0.2553, 0.3662], abs=1e-4
    )
    assert tally.share([])["share"] is None


def test_targets_and_who_is_ahead() -> None:
    ours = tally.scores(RESULTS, WHO)
    met = {target["score"]: target["met"] for target in tally.targets(ours)}
    assert met == {
        "location": False, "effect": False, "false_alarms": False, "coverage": False,
        "unknown": False, "unknown_place": True,
        "levels": None, "changes": None, "false_changes": None,
    }  # fmt: skip
    theirs = tally.scores([result(hidden=((DRY, 20.0),), said=("",)), result("null")], WHO)
    ahead = tally.ahead(ours, theirs)
    assert (ahead["location"], ahead["effect"], ahead["false_alarms"]) == (True, True, False)
    assert ahead["unknown"] is None


def test_confusion_power_and_calibration() -> None:
    assert tally.confusion(RESULTS, WHO) == {
        DRY: {DRY: 2, "joint.stop": 1},
        PLAY: {"nothing": 1},
        MAGNET: {"unknown": 1, DRY: 1},
        "nothing": {"nothing": 2, "joint.stop": 2},
    }
    power = tally.power(RESULTS, WHO)
    assert [(p["visibility"], p["located"], p["named"]) for p in power[DRY]] == [
        (4.0, True, False), (9.0, True, True), (20.0, True, True),
    ]  # fmt: skip
    assert [p["located"] for p in power[PLAY]] == [False, False]
    curve = {point["nominal"]: point["covered"] for point in tally.calibration(RESULTS, WHO)}
    # distances 0.5, 2.5 and none: 0.5 is inside from 38 % on, 2.5 from 98.8 %
    assert (curve[0.3], curve[0.4], curve[0.95]) == pytest.approx((0.0, 1 / 3, 1 / 3))
    assert curve[0.99] == pytest.approx(2 / 3)
    assert math.isclose(2 * (1 - 0.5 * (1 + math.erf(0.5 / math.sqrt(2)))), 0.617, abs_tol=1e-3)
