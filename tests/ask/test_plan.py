"""Which causes could be told apart, before anything is recorded."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.ask.conftest import XML
from wt.ask.plan import Apart, Plan, plan
from wt.ask.plan_page import page, sentences
from wt.cli.main import main

TRAILS = XML.replace(
    "</body></worldbody>",
    '<body pos=".3 0 0"><joint name="free" axis="0 1 0" damping=".01"/>'
    '<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/></body></body></worldbody>',
)
UPRIGHT = XML.replace('axis="0 1 0"', 'axis="0 0 1"')
SPINS = TRAILS.replace('name="free" axis="0 1 0"', 'name="free" axis="1 0 0"')
ENCODER = '<jointpos joint="j"/>'


def sensing(xml: str, sensors: str) -> str:
    """The same machine with sensors; ``imu`` is a site at the end of the passive link."""
    placed = xml.replace(' damping=".01"/>', ' damping=".01"/><site name="imu"/>')
    return placed.replace("</mujoco>", f"<sensor>{sensors}</sensor></mujoco>")


SENSING = {
    "one": sensing(TRAILS, ENCODER),
    "gyro": sensing(TRAILS, ENCODER + '<gyro name="g" site="imu"/>'),
    "spins": sensing(SPINS, ENCODER),
    "force": sensing(UPRIGHT, ENCODER + '<actuatorfrc actuator="a"/><clock name="watch"/>'),
    "speed": sensing(UPRIGHT, '<jointvel joint="j"/>'),
}


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Plan]:
    """Of an arm that swings up and down, one about a vertical axis, and one with a passive link."""
    folder = tmp_path_factory.mktemp("plans")
    found = {}
    for name, xml in (("swings", XML), ("turns", UPRIGHT), ("trails", TRAILS)):
        path = folder / f"{name}.xml"
        path.write_text(xml)
        found[name] = plan(path)
    return found


@pytest.fixture(scope="module")
def sensed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Plan]:
    """The same machines with the sensors that these declare."""
    folder = tmp_path_factory.mktemp("sensed")
    found = {}
    for name, xml in SENSING.items():
        path = folder / f"{name}.xml"
        path.write_text(xml)
        found[name] = plan(path)
    return found


def pair(found: Plan, *effects: str, joint: str = "j") -> Apart:
    """The pair of two effects at a joint."""
    (one,) = [p for p in found.joints[joint] if {c.effect for c in p.causes} == set(effects)]
    return one


def test_gravity_tells_an_encoders_zero_from_a_drives_bias(plans: dict[str, Plan]) -> None:
    confused = "actuator.bias", "sensor.offset"
    assert pair(plans["turns"], *confused).never
    assert not pair(plans["swings"], *confused).never


def test_what_one_number_says_by_two_names_is_never_told_apart(plans: dict[str, Plan]) -> None:
    # a single link that turns: its inertia is all that its motion shows
    assert pair(plans["turns"], "body.inertia", "joint.armature").never


def test_dry_and_viscous_friction_are_told_apart_at_once(plans: dict[str, Plan]) -> None:
    for found in (plans["swings"], plans["turns"]):
        friction = pair(found, "joint.friction_coulomb", "joint.friction_viscous")
        assert friction.times < 2.0 and friction.motion


def test_late_commands_and_a_lag_need_what_is_sudden(plans: dict[str, Plan]) -> None:
    late = pair(plans["swings"], "actuator.delay", "actuator.lag")
    assert late.times > 3.0 and late.motion in ("steps", "swings at many frequencies")


def test_a_joint_that_nothing_drives_is_compared_too(plans: dict[str, Plan]) -> None:
    found = plans["trails"]
    assert list(found.joints) == ["j", "free"]
    friction = pair(found, "joint.friction_coulomb", "joint.friction_viscous", joint="free")
    assert friction.times < 3.0
    # no drive loads it: friction by its load is dry friction
    assert pair(found, "joint.friction_coulomb", "joint.friction_load", joint="free").never


def test_what_has_no_encoder_shows_by_what_it_does_to_the_rest(
    plans: dict[str, Plan], sensed: dict[str, Plan]
) -> None:
    zero = "actuator.bias", "sensor.offset"
    every, one, gyro = plans["trails"], sensed["one"], sensed["gyro"]
    assert sensed["one"].sensors.joints == ("j",) and every.sensors.joints == ("j", "free")
    friction = pair(one, "joint.friction_coulomb", "joint.friction_viscous", joint="free")
    assert friction.times < 3.0
    causes = {c for p in one.joints["free"] for c in p.causes}
    assert not any(c.effect.startswith("sensor.") and c.at.name == "free" for c in causes)
    # the passive link's encoder helps to tell the other's zero, and so does a gyro on it
    assert pair(one, *zero).times > 2.0 * pair(every, *zero).times
    assert pair(gyro, *zero).times == pytest.approx(pair(every, *zero).times, rel=0.05)


def test_what_no_sensor_shows_is_said(sensed: dict[str, Plan]) -> None:
    """A link that turns about the first one's own direction, and nothing measures how."""
    found = sensed["spins"]
    said = sentences(found)
    assert said[0] == "Measured: the position of j."
    assert "joint.friction_viscous at joint free shows in none of these sensors" in said
    assert {c.at.name for c in found.unseen} <= {"free", "j+free"}
    assert {"effect": "joint.armature", "at": {"kind": "joint", "name": "free"}} in found.to_json()[
        "never_shown"
    ]


def test_a_measured_force_shows_whether_it_is_the_drive(sensed: dict[str, Plan]) -> None:
    found = sensed["force"]
    assert found.sensors.drives == ("a",) and found.sensors.others == ("watch",)
    assert sentences(found)[0] == "Measured: the position of j; the force of a; not used: watch."
    for p in found.joints["j"]:
        kinds = {c.effect.partition(".")[0] for c in p.causes}
        if kinds in ({"actuator", "joint"}, {"actuator", "body"}):
            assert p.times < 1.5, p
    # what a drive is told of its joint is no force
    assert pair(found, "actuator.bias", "sensor.offset").never


def test_a_velocity_has_no_zero(sensed: dict[str, Plan]) -> None:
    found = sensed["speed"]
    assert found.sensors.speeds == ("j",) and not found.sensors.joints
    assert not any(c.effect == "sensor.offset" for p in found.joints["j"] for c in p.causes)


def test_people_are_told_what_is_hard(plans: dict[str, Plan]) -> None:
    said = sentences(plans["turns"])
    zero = [s for s in said if "actuator.bias" in s and "sensor.offset" in s]
    assert zero == [
        "j: actuator.bias at actuator a and sensor.offset at joint j are never told apart"
    ]
    assert not any("friction_viscous" in s and "friction_coulomb" in s for s in said)
    html = page(plans["turns"], "arm.xml")
    assert "Joint j" in html and "never" in html and html.count("<table") == 2


@pytest.mark.long
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(UPRIGHT)
    words = ["diagnose", str(model), "--plan", "--out", str(tmp_path / "plan")]
    assert main(words) == 0
    assert "are never told apart" in " ".join(capsys.readouterr().out.split())
    said = json.loads((tmp_path / "plan" / "plan.json").read_text())
    never = [p for p in said["joints"]["j"] if p["times"] is None]
    assert never and all(p["motion"] is None for p in never)
    (tmp_path / "plan" / "mine.txt").write_text("kept")
    assert main(words) == 2
    assert "holds what no wt diagnose --plan wrote" in capsys.readouterr().err
    assert main([*words[:2], str(tmp_path / "a.parquet"), *words[2:]]) == 2
    assert "--plan takes MODEL.xml alone" in capsys.readouterr().err
