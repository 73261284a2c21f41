"""Marks against hand-written diagnoses."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from wt.prove.cases import Case, HiddenEffect, cases
from wt.prove.score import score


def case(*truth: HiddenEffect) -> Case:
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


COULOMB = HiddenEffect(
    "joint.friction_coulomb", "joint", "elbow", {"coulomb": 0.5}, "joint.friction_coulomb"
)
GAIN = HiddenEffect("actuator.gain", "actuator", "shoulder_drive", {"factor": 0.8}, "actuator.gain")


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
    truth = HiddenEffect("body.force", "body", "fore", {"force": [3.0, 0.0, 4.0]}, "body.force")
    said = finding("body.force", "body", "fore",
                   force={"value": [3.0, 0.5, 4.0], "ci95": [[2, 4], [-1, 1], [3, 5]]})  # fmt: skip
    marks = score(diagnosis(said), case(truth))
    assert marks.errors["body.force.force"] == pytest.approx(0.1)
    assert marks.covered["body.force.force"]
    parameters: dict[str, object] = {"angle": 0.1, "direction": 3.1}
    tilt = HiddenEffect("world.gravity", "world", "world", parameters, "world.gravity")
    said = finding("world.gravity", "world", "world", angle={"value": 0.1},
                   direction={"value": -3.1, "ci95": [-3.2, -3.0]})  # fmt: skip
    marks = score(diagnosis(said), case(tilt))
    assert marks.errors["world.gravity.direction"] == pytest.approx(2 * 3.14159265 - 6.2, abs=1e-6)
    assert marks.covered["world.gravity.direction"]


def test_places_that_are_one() -> None:
    cable = HiddenEffect("unknown", "pair", "shoulder+elbow", {}, "outsider.cable",
                  accept=(("joint", "shoulder"), ("joint", "elbow")))  # fmt: skip
    for kind, name in (("pair", "elbow+shoulder"), ("joint", "elbow"), ("actuator", "elbow_drive")):
        assert score(diagnosis(finding("unknown", kind, name)), case(cable)).effect
    assert not score(diagnosis(finding("unknown", "joint", "waist")), case(cable)).location
    late = HiddenEffect("sensor.delay", "sensor", "all", {"delay": 0.01}, "sensor.delay")
    assert score(diagnosis(finding("sensor.delay", "joint", "all")), case(late)).effect


def test_of_a_wall_the_distance_counts() -> None:
    parameters: dict[str, object] = {"position": [0.4, 0.3, 0.0], "normal": [0.0, -1.0, 0.0]}
    wall = HiddenEffect("contact.obstacle", "world", "world", parameters, "contact.obstacle")
    said = finding("contact.obstacle", "world", "world",
                   position={"value": [0.1, 0.305, 0.7], "ci95": [[0, 0.29, 0], [1, 0.32, 1]]},
                   normal={"value": [0.0, -0.995, 0.1]})  # fmt: skip
    marks = score(diagnosis(said), case(wall))
    assert marks.errors["contact.obstacle.position"] == pytest.approx(0.005 / 0.5)
    assert marks.covered == {"contact.obstacle.position": True}
    assert marks.errors["contact.obstacle.normal"] == pytest.approx(0.1, rel=0.01)
    there = {"value": [0.4, 0.35, 0.0], "ci95": [[0.3, 0.34, -1], [0.5, 0.36, 1]]}
    far = finding("contact.obstacle", "world", "world", position=there)
    assert score(diagnosis(far), case(wall)).covered == {"contact.obstacle.position": False}


def test_a_payload_that_moves() -> None:
    parameters: dict[str, object] = {"mass": 4.0, "travel": 0.2, "position": [0.0, 0.0, 0.1]}
    ball = HiddenEffect("body.payload_moving", "body", "trunk", parameters, "payload.rails")
    said = finding("body.payload_moving", "body", "trunk",
                   mass={"value": 4.4, "ci95": [3.9, 4.9]}, travel={"value": 0.19})  # fmt: skip
    marks = score(diagnosis(said), dataclasses.replace(case(ball), rig="quadruped"))
    assert marks.effect
    assert marks.errors["body.payload_moving.mass"] == pytest.approx(0.1)
    assert marks.errors["body.payload_moving.travel"] == pytest.approx(0.05)
    assert marks.covered == {"body.payload_moving.mass": True}
