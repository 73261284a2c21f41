"""Marks against hand-written diagnoses."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from wt.prove.cases import Case, Truth, cases
from wt.prove.score import score


def case(*truth: Truth) -> Case:
    return dataclasses.replace(cases("nulls")[0], rig="arm3", truth=truth)


def finding(effect: str, kind: str, name: str, **parameters: object) -> dict[str, Any]:
    return {
        "effect": effect,
        "at": {"kind": kind, "name": name},
        "parameters": parameters,
        "confusable_with": [],
    }


def diagnosis(*findings: dict[str, Any]) -> dict[str, Any]:
    return {
        "findings": list(findings),
        "fit": {"holdout": {"after_rmse": 3e-4, "noise_floor_rmse": 2e-4}},
    }


COULOMB = Truth(
    "joint.friction_coulomb", "joint", "elbow", {"coulomb": 0.5}, "joint.friction_coulomb"
)
GAIN = Truth("actuator.gain", "actuator", "shoulder_drive", {"factor": 0.8}, "actuator.gain")


def test_right_answer() -> None:
    said = finding("joint.friction_coulomb", "joint", "elbow",
                   coulomb={"value": 0.55, "unit": "N·m", "ci95": [0.4, 0.6]})  # fmt: skip
    marks = score(diagnosis(said), case(COULOMB))
    assert (marks.location, marks.effect, marks.false_claims) == (True, True, 0)
    assert marks.errors == {"joint.friction_coulomb.coulomb": pytest.approx(0.1)}
    assert marks.covered == {"joint.friction_coulomb.coulomb": True}
    assert marks.after == pytest.approx(1.5)


def test_wrong_name_at_the_right_place() -> None:
    said = finding("actuator.deadband", "actuator", "elbow_drive", width={"value": 0.5})
    marks = score(diagnosis(said), case(COULOMB))
    assert (marks.location, marks.effect, marks.effect_top_or_confusable) == (True, False, False)
    assert marks.errors == {}
    said["confusable_with"] = [{"effect": "joint.friction_coulomb"}]
    assert score(diagnosis(said), case(COULOMB)).effect_top_or_confusable


def test_right_name_at_the_wrong_place() -> None:
    said = finding("joint.friction_coulomb", "joint", "shoulder")
    marks = score(diagnosis(said), case(COULOMB))
    assert (marks.location, marks.effect) == (False, False)


def test_nothing_said_of_something() -> None:
    marks = score(diagnosis(), case(COULOMB))
    assert (marks.location, marks.effect, marks.false_claims) == (False, False, 0)


def test_any_word_is_false_where_nothing_is_hidden() -> None:
    said = finding("unknown", "joint", "elbow")
    assert score(diagnosis(said), case()).false_claims == 1
    assert score(diagnosis(), case()).false_claims == 0
    assert score(diagnosis(), case()).location is None


def test_two_effects_in_either_order_and_one_too_many() -> None:
    both = case(COULOMB, GAIN)
    a = finding("joint.friction_coulomb", "joint", "elbow", coulomb={"value": 0.5})
    b = finding("actuator.gain", "joint", "shoulder", factor={"value": 0.8, "ci95": [0.81, 0.9]})
    for order in ((a, b), (b, a)):
        marks = score(diagnosis(*order, finding("unknown", "joint", "waist")), both)
        assert (marks.location, marks.effect, marks.false_claims) == (True, True, 1)
    assert marks.covered == {"actuator.gain.factor": False}
    half = score(diagnosis(a), both)
    assert (half.location, half.effect) == (False, False)


def test_vectors_and_angles() -> None:
    truth = Truth("body.force", "body", "fore", {"force": [3.0, 0.0, 4.0]}, "body.force")
    said = finding("body.force", "body", "fore",
                   force={"value": [3.0, 0.5, 4.0], "ci95": [[2, 4], [-1, 1], [3, 5]]})  # fmt: skip
    marks = score(diagnosis(said), case(truth))
    assert marks.errors["body.force.force"] == pytest.approx(0.1)
    assert marks.covered["body.force.force"]
    parameters: dict[str, object] = {"angle": 0.1, "direction": 3.1}
    tilt = Truth("world.gravity", "world", "world", parameters, "world.gravity")
    said = finding("world.gravity", "world", "world", angle={"value": 0.1},
                   direction={"value": -3.1, "ci95": [-3.2, -3.0]})  # fmt: skip
    marks = score(diagnosis(said), case(tilt))
    assert marks.errors["world.gravity.direction"] == pytest.approx(2 * 3.14159265 - 6.2, abs=1e-6)
    assert marks.covered["world.gravity.direction"]


def test_places_that_are_one() -> None:
    cable = Truth("unknown", "pair", "shoulder+elbow", {}, "outsider.cable",
                  accept=(("joint", "shoulder"), ("joint", "elbow")))  # fmt: skip
    for kind, name in (("pair", "elbow+shoulder"), ("joint", "elbow"), ("actuator", "elbow_drive")):
        assert score(diagnosis(finding("unknown", kind, name)), case(cable)).effect
    assert not score(diagnosis(finding("unknown", "joint", "waist")), case(cable)).location
    late = Truth("sensor.delay", "sensor", "all", {"delay": 0.01}, "sensor.delay")
    assert score(diagnosis(finding("sensor.delay", "joint", "all")), case(late)).effect
