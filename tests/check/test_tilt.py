"""How the base stands: what drives carry tells it where nothing else explains as much."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from tests.check.machines import MACHINES, record
from wt.check.finding import AuditFinding
from wt.check.run import check
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


def found(xml: str, robot: str, folder: Path, name: str = "arm4") -> list[AuditFinding]:
    (folder / "m.xml").write_text(xml)
    recording = record(name, 70, robot=robot, seconds=6.0)
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
