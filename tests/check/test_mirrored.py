"""Faults of all drives at once, which no step from one column to the next arrives at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.check.machines import MACHINES, record, times, with_columns, write_model
from wt.check.finding import AuditFinding
from wt.check.run import check
from wt.physics.scene import Scene
from wt.types import Recording


def faults(name: str, recording: Recording, folder: Path, xml: str = "") -> list[AuditFinding]:
    path = write_model(name, folder)
    if xml:
        path.write_text(xml)
    return [f for f in check(Scene(path), recording).findings if f.sure]


@pytest.mark.parametrize("name", ["arm4", "planar"])
@pytest.mark.parametrize("group", ["qpos qvel", "ctrl"])
def test_all_encoders_backwards_are_not_all_commands(group: str, name: str, tmp_path: Path) -> None:
    clean = record(name, 80)
    names = [n for n in clean.columns if n.partition("/")[0] in group.split()]
    found = faults(name, times(-1.0, *names)(clean), tmp_path)
    kind = "command_sign" if group == "ctrl" else "encoder_sign"
    assert {f.kind for f in found} == {kind}
    assert {c for f in found for c in f.columns} == set(names)


def test_weight_that_the_robot_carries_gives_no_encoder_a_gear(tmp_path: Path) -> None:
    """A torque drive's command is nearly all weight: another unit makes up for a part of it."""
    xml = MACHINES["planar_torque"].xml
    robot = xml.replace("<body name=", '<body gravcomp="1" name=')
    for seed in (81, 82, 83):
        found = faults("planar_torque", record("planar_torque", seed, robot=robot), tmp_path)
        assert [f.kind for f in found] == ["gravcomp_missing"]


PAN = """<mujoco><compiler angle="radian"/><option timestep="0.001"/><worldbody>
<body pos="0 0 1"><joint name="hip" axis="0 0 1" damping=".08" armature=".01"/>
<geom type="cylinder" size=".05 .04" mass=".8"/><body pos=".01 0 .08">
<joint name="knee" axis="0 1 0" damping=".06" armature=".008"/>
<geom type="box" size=".09 .08 .07" pos=".06 .01 .05" mass="1.4" contype="0"/></body></body>
</worldbody><actuator><position name="hip_m" joint="hip" kp="14" kv=".9"/>
<position name="knee_m" joint="knee" kp="22" kv="1.1"/></actuator></mujoco>"""


def test_two_servos_that_are_exchanged_whole_are_told_by_little(tmp_path: Path) -> None:
    """Most of what each of them commands is its own rotor's."""
    clean = record("planar", 84, robot=PAN)
    pairs = [(n, n.replace("hip", "knee")) for n in clean.columns if "hip" in n]
    both = {a: clean.columns[b] for a, b in pairs} | {b: clean.columns[a] for a, b in pairs}
    (found,) = faults("planar", with_columns(clean, both), tmp_path, PAN)
    assert found.kind == "joints_swapped"


def test_a_frozen_position_under_commands_of_speed(tmp_path: Path) -> None:
    xml = MACHINES["rod"].xml.replace("0 1 0", "0 0 1").replace('armature="0.01"', 'armature=".1"')
    xml = xml.replace('<position name="hinge_m" joint="hinge" kp="30" kv="2"/>',
                      '<velocity name="hinge_m" joint="hinge" kv="5"/>')  # fmt: skip
    t = np.arange(500) / 100.0
    columns = {"qpos/hinge": np.full(500, 0.3), "qvel/hinge": np.zeros(500)}
    still = Recording(t, {**columns, "ctrl/hinge_m": np.sin(1.5 * t)})
    (found,) = faults("rod", still, tmp_path, xml)
    assert (found.kind, found.columns) == ("frozen", ("qpos/hinge",))
