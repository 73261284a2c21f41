"""How the base stands: what drives carry tells it where nothing else explains as much."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.check.machines import HEAD, MACHINES, record
from wt.check.audit import Subject
from wt.check.finding import AuditFinding
from wt.check.run import check, one_model
from wt.physics.scene import Scene

LEVEL = MACHINES["planar"].xml
for upright, level in (
    ('axis="0 1 0"', 'axis="0 0 1"'), ("0 0 0 0 0 -.4", "0 0 0 .4 0 0"),
    ("0 0 0 .05 0 -.35", "0 0 0 .35 .05 0"), ('pos="0 0 -.4"', 'pos=".4 0 0"'),
):  # fmt: skip
    LEVEL = LEVEL.replace(upright, level)


def leaning(xml: str, degrees: float, towards: float) -> str:
    tilt, side = math.radians(degrees), math.radians(towards)
    x, y = math.sin(tilt) * math.cos(side), math.sin(tilt) * math.sin(side)
    pull = f"{9.81 * x} {9.81 * y} {-9.81 * math.cos(tilt)}"
    return xml.replace("<worldbody>", f'<option gravity="{pull}"/><worldbody>')


def found(
    xml: str, robot: str, folder: Path, name: str = "arm4", rate: float = 100.0
) -> list[AuditFinding]:
    (folder / "m.xml").write_text(xml)
    recording = record(name, 70, robot=robot, seconds=6.0, rate=rate)
    return list(check(Scene(folder / "m.xml"), recording).findings)


def angle(finding: AuditFinding) -> float:
    (said,) = re.findall(r"([0-9]+)° from the model's gravity", finding.evidence)
    return float(said)


@pytest.mark.parametrize(("degrees", "sure"), [(10.0, False), (14.0, False), (25.0, True)])
def test_a_small_tilt_is_noted_and_a_larger_one_is_a_fault(
    degrees: float, sure: bool, tmp_path: Path
) -> None:
    """Below, wt diagnose measures it, with an interval."""
    xml = MACHINES["arm4"].xml
    (tilt,) = found(xml, leaning(xml, degrees, 130.0), tmp_path)
    assert (tilt.kind, tilt.sure) == ("base_orientation", sure)
    assert angle(tilt) == pytest.approx(degrees, abs=1.6)


@pytest.mark.parametrize("gain", [0.75, 1.3])
def test_a_base_is_told_beside_weak_and_strong_drives(gain: float, tmp_path: Path) -> None:
    xml = MACHINES["arm4"].xml
    robot = re.sub(r'k([pv])="([0-9.]+)"', lambda k: f'k{k[1]}="{gain * float(k[2])}"', xml)
    (tilt,) = found(xml, leaning(robot, 90.0, 0.0), tmp_path)
    assert (tilt.kind, tilt.sure) == ("base_orientation", True)
    assert "[9.8, 0, 0]" in tilt.evidence


def test_a_machine_that_feels_no_weight_as_it_stands(tmp_path: Path) -> None:
    """Two links about axles that are upright in the model, on a wall."""
    (tilt,) = found(LEVEL, leaning(LEVEL, 90.0, 90.0), tmp_path, "planar")
    assert (tilt.kind, tilt.sure) == ("base_orientation", True)
    assert "[0, 9.8, 0]" in tilt.evidence


ROLLED = MACHINES["planar_torque"].xml.replace(
    '<joint name="hip" axis="0 1 0" damping="0.1"/>',
    '<joint name="hip" axis="1 0 0" damping="0.1" range="-1.2 1.2"/>',
).replace('<worldbody><body name="a" pos="0 0 1">',
          '<worldbody><body pos="0 0 .5"><geom size=".1"/><body name="a" pos="0 .1 .5">').replace(
    "</worldbody>", "</body></worldbody>"
)  # fmt: skip
"""A leg whose first axle is level, on a frame that stands still."""


def test_a_base_upside_down_is_no_encoders_zero_beyond_its_limits(tmp_path: Path) -> None:
    """Half a turn about the first axle would be as good, but for where that joint may go."""
    (tilt,) = found(ROLLED, leaning(ROLLED, 180.0, 0.0), tmp_path, "planar_torque")
    assert (tilt.kind, tilt.sure) == ("base_orientation", True)
    assert "180°" in tilt.evidence


def test_a_base_turned_about_the_first_axle_is_said_with_its_zero(tmp_path: Path) -> None:
    unlimited = ROLLED.replace(' range="-1.2 1.2"', "")
    (zero,) = found(unlimited, leaning(unlimited, 90.0, 90.0), tmp_path, "planar_torque")
    assert (zero.kind, zero.columns) == ("encoder_zero", ("qpos/hip",))
    assert "or the base turned about its axle" in zero.evidence


def finger(lean: float, first: str, second: str) -> str:
    """Two links about axles that are nearly along y, lying along x."""
    geom = 'type="capsule" size=".02" contype="0" conaffinity="0"'
    return (
        f'<body pos="0 {lean} 1" euler="{lean} 0 0"><joint name="{first}" axis="0 1 0"/>'
        f'<geom {geom} fromto="0 0 0 .3 0 0" mass=".6"/><body pos=".3 0 0">'
        f'<joint name="{second}" axis="0 1 0"/><geom {geom} fromto="0 0 0 .2 0 0" mass=".3"/>'
        "</body></body>"
    )


def hand(lean: float, other: float) -> str:
    servos = "".join(
        f'<position name="{joint}_m" joint="{joint}" kp="{kp}" kv="{kp / 15}"/>'
        for joint, kp in (("yaw", 25), ("lift", 3), ("bend", 25), ("roll", 3))
    )
    fingers = finger(lean, "yaw", "lift") + finger(other, "bend", "roll")
    return (
        f"""<mujoco>{HEAD}<worldbody>{fingers}</worldbody><actuator>{servos}</actuator></mujoco>"""
    )


def test_a_hand_on_a_wall_that_feels_little_weight_compensates_none(tmp_path: Path) -> None:
    xml = hand(0.1, -0.1)
    (tilt,) = found(xml, leaning(xml, 90.0, 90.0), tmp_path)
    assert (tilt.kind, angle(tilt)) == ("base_orientation", 90.0)


def test_of_two_changes_of_the_model_that_explains_most_is_made(tmp_path: Path) -> None:
    """Softer servos, too, explain a part of a weight that nobody carries."""
    xml = hand(0.1, -0.4)
    (tmp_path / "m.xml").write_text(xml)
    robot = xml.replace("<body ", '<body gravcomp="1" ')
    subject = Subject(Scene(tmp_path / "m.xml"), record("arm4", 70, robot=robot, seconds=6.0))

    def softer(spec: mujoco.MjSpec) -> None:
        for actuator in spec.actuators:
            actuator.gainprm, actuator.biasprm = actuator.gainprm / 4, actuator.biasprm / 4

    def carried(spec: mujoco.MjSpec) -> None:
        for body in spec.bodies[1:]:
            body.gravcomp = 1.0

    both = [
        AuditFinding(kind, (), (), "", "", model_change=change)
        for kind, change in (("gain_unit", softer), ("gravcomp_missing", carried))
    ]
    note = AuditFinding("masses_guessed", (), (), "", "", 0.5)
    assert one_model(subject, [*both, note]) == [both[1], note]


def test_a_fast_log_may_leave_more_than_its_noise(tmp_path: Path) -> None:
    """Where nothing else explains nearly as much: little of what is left is the direction's."""
    xml = hand(0.1, -0.4)
    (tilt,) = found(xml, leaning(xml, 50.0, 300.0), tmp_path, rate=500.0)
    assert (tilt.kind, tilt.sure) == ("base_orientation", True)
    assert angle(tilt) == pytest.approx(50.0, abs=2.5)


@pytest.mark.parametrize("towards", [0.0, 90.0, 180.0])
def test_a_torque_driven_arm_on_a_wall(towards: float, tmp_path: Path) -> None:
    """Not an encoder's zero and another direction for the rest."""
    xml = MACHINES["arm4_torque"].xml
    (tilt,) = found(xml, leaning(xml, 90.0, towards), tmp_path, "arm4_torque")
    assert (tilt.kind, tilt.sure) == ("base_orientation", True)
    assert angle(tilt) == 90.0


@pytest.mark.parametrize(
    "robot",
    [
        LEVEL.replace('name="hip"', 'name="hip" stiffness="6" springref=".4"'),
        LEVEL.replace('name="knee"', 'name="knee" stiffness="4"'),
    ],
)
def test_springs_are_no_tilt_of_a_machine_that_feels_no_weight(robot: str, tmp_path: Path) -> None:
    assert not found(LEVEL, robot, tmp_path, "planar")


@pytest.mark.parametrize("gain", [0.75, 1.3])
def test_weight_that_nobody_carries_beside_weak_and_strong_drives(
    gain: float, tmp_path: Path
) -> None:
    xml, rng = MACHINES["arm4_torque"].xml, np.random.default_rng(5)
    gears = iter(gain * rng.uniform(0.9, 1.1, 4))
    robot = re.sub("<motor ", lambda _: f'<motor gear="{next(gears)}" ', xml)
    robot = robot.replace("<body name=", '<body gravcomp="1" name=')
    (carried,) = found(xml, robot, tmp_path, "arm4_torque")
    assert carried.kind == "gravcomp_missing"
