"""What a model is to blame for, alone and beside a recording."""

from __future__ import annotations

import re
from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from tests.check.machines import MACHINES, record, with_columns
from wt.check.audits import gravity
from wt.check.balance import Balance
from wt.check.finding import AuditFinding
from wt.check.run import check
from wt.physics.effect import effects
from wt.physics.scene import Scene
from wt.types import Location


def kinds(xml: str, folder: Path, recording: object = None) -> list[str]:
    path = folder / "m.xml"
    path.write_text(xml)
    return [f.kind for f in check(Scene(path), recording).findings if f.sure]  # type: ignore[arg-type]


def compensated(xml: str) -> str:
    return xml.replace("<body name=", '<body gravcomp="1" name=')


@pytest.mark.parametrize("name", ["planar", "planar_torque", "arm4", "arm4_torque"])
def test_gravity_that_the_robot_carries_itself(name: str, tmp_path: Path) -> None:
    xml = MACHINES[name].xml
    r = record(name, 40, robot=compensated(xml))
    assert kinds(xml, tmp_path, r) == ["gravcomp_missing"]
    assert kinds(compensated(xml), tmp_path, r) == []


@pytest.mark.parametrize("name", ["planar", "arm4_torque"])
def test_gravity_that_the_model_alone_compensates(name: str, tmp_path: Path) -> None:
    xml = MACHINES[name].xml
    assert kinds(compensated(xml), tmp_path, record(name, 41)) == ["gravcomp_extra"]


def test_half_of_it_is_physics(tmp_path: Path) -> None:
    xml = MACHINES["arm4"].xml
    r = record("arm4", 42, robot=xml.replace("<body name=", '<body gravcomp=".5" name='))
    assert kinds(xml, tmp_path, r) == []


@pytest.mark.parametrize("gravity", ["0 0 9.81", "9.81 0 0", "0 -9.81 0"])
def test_a_base_that_hangs_otherwise(gravity: str, tmp_path: Path) -> None:
    xml = MACHINES["arm4"].xml
    robot = xml.replace("<worldbody>", f'<option gravity="{gravity}"/><worldbody>')
    r = record("arm4", 43, robot=robot)
    path = tmp_path / "m.xml"
    path.write_text(xml)
    (found,) = [f for f in check(Scene(path), r).findings if f.sure]
    assert found.kind == "base_orientation"
    assert found.model_change is not None
    spec = mujoco.MjSpec.from_string(xml)
    found.model_change(spec)
    assert spec.option.gravity == pytest.approx([float(x) for x in gravity.split()], abs=1e-9)


def test_a_base_that_leans(tmp_path: Path) -> None:
    xml = MACHINES["arm4"].xml
    robot = xml.replace("<worldbody>", '<option gravity="4.9 3 -7.9"/><worldbody>')
    assert kinds(xml, tmp_path, record("arm4", 46, robot=robot)) == ["base_orientation"]


@pytest.mark.parametrize("pull", [(-0.8, 0.25, 0.45), (0.5, 0.5, 0.5)])
def test_what_pulls_at_one_body_is_physics(
    pull: tuple[float, float, float], tmp_path: Path
) -> None:
    """A rope at one link bends the weight of all of them by 40°, and more."""
    xml = MACHINES["arm4"].xml
    spec = mujoco.MjSpec.from_string(xml)
    at = Location("body", spec.bodies[-1].name)
    weight = 9.81 * sum(spec.compile().body_mass[1:])
    effects()["body.force"].patch(spec, at, 0.2 * weight * np.array(pull))
    assert kinds(xml, tmp_path, record("arm4", 47, robot=spec.to_xml())) == []


def test_limits_that_the_recording_leaves(tmp_path: Path) -> None:
    xml = MACHINES["arm4"].xml.replace('name="lift"', 'name="lift" range="-.2 .2"')
    assert kinds(xml, tmp_path, record("arm4", 44)) == ["joint_limit"]


def test_limits_in_degrees_are_no_unit_of_the_log(tmp_path: Path) -> None:
    """A range of ±1° and a log of ±60°: in degrees the log would fit, and weigh nothing."""
    xml = MACHINES["arm4"].xml.replace('name="bend"', 'name="bend" range="-.017 .017"')
    assert kinds(xml, tmp_path, record("arm4", 44)) == ["joint_limit"]


def stiffer(factor: float, *joints: str, damping: bool = True) -> str:
    """The arm with other gains of some servos, or of all; ``damping`` too, or kp alone."""

    def scaled(found: re.Match[str]) -> str:
        if joints and found[1] not in joints:
            return found[0]
        kp, kv = (factor * float(x) for x in found.groups()[1:])
        kv = kv if damping else float(found[3])
        return f'joint="{found[1]}" kp="{kp:.8g}" kv="{kv:.8g}"'

    return re.sub(r'joint="(\w+)" kp="([.0-9]+)" kv="([.0-9]+)"', scaled, MACHINES["arm4"].xml)


@pytest.mark.parametrize("factor", [57.29578, 1.0 / 57.29578, 1000.0, 1e-3])
def test_gains_in_another_unit(factor: float, tmp_path: Path) -> None:
    """Nothing else is said: with them mended, no column needs a unit and no model explodes."""
    path = tmp_path / "m.xml"
    path.write_text(stiffer(factor))
    (found,) = check(Scene(path), record("arm4", 48)).findings
    assert (found.kind, found.sure) == ("gain_unit", True)
    change = found.model_change
    assert change is not None
    spec = mujoco.MjSpec.from_file(str(path))
    change(spec)
    right = mujoco.MjModel.from_xml_string(MACHINES["arm4"].xml)
    mended = spec.compile()
    np.testing.assert_allclose(mended.actuator_gainprm, right.actuator_gainprm, rtol=1e-4)
    np.testing.assert_allclose(mended.actuator_biasprm, right.actuator_biasprm, rtol=1e-4)


@pytest.mark.parametrize(
    ("factor", "damping"),
    [
        (5.0, True),
        (0.2, True),
        (16.0, True),
        (90.0, True),
        (5.0, False),
        (90.0, False),
        (0.2, False),
    ],
)
def test_gains_of_no_unit(factor: float, damping: bool, tmp_path: Path) -> None:
    """Any factor that all servos share; where kp alone has it, kv stays."""
    path = tmp_path / "m.xml"
    path.write_text(stiffer(factor, damping=damping))
    (found,) = [f for f in check(Scene(path), record("arm4", 48)).findings if f.kind[:5] != "model"]
    assert (found.kind, found.sure) == ("gain_unit", True)
    assert found.model_change is not None
    spec = mujoco.MjSpec.from_file(str(path))
    found.model_change(spec)
    right, mended = mujoco.MjModel.from_xml_string(MACHINES["arm4"].xml), spec.compile()
    np.testing.assert_allclose(mended.actuator_gainprm, right.actuator_gainprm, rtol=0.08)
    np.testing.assert_allclose(mended.actuator_biasprm, right.actuator_biasprm, rtol=0.08)


@pytest.mark.parametrize(("factor", "damping"), [(57.29578, True), (20.0, False)])
def test_gains_in_another_unit_of_drives_that_differ(
    factor: float, damping: bool, tmp_path: Path
) -> None:
    """No physics makes every servo ten times as soft, by the same factor or not."""
    robot, own = MACHINES["arm4"].xml, iter((0.75, 1.3, 1.15, 0.9))

    def worn(found: re.Match[str]) -> str:
        gain = next(own)
        return f'kp="{gain * float(found[1]):.8g}" kv="{gain * float(found[2]):.8g}"'

    robot = re.sub(r'kp="([.0-9]+)" kv="([.0-9]+)"', worn, robot)
    recording = record("arm4", 48, robot=robot)
    found = kinds(stiffer(factor, damping=damping), tmp_path, recording)
    assert [kind for kind in found if kind != "model_explodes"] == ["gain_unit"]


@pytest.mark.parametrize(("factor", "joints"), [(2.0, ()), (5.0, ("bend",)), (57.3, ("bend",))])
def test_other_gains_are_physics(factor: float, joints: tuple[str, ...], tmp_path: Path) -> None:
    found = kinds(stiffer(factor, *joints), tmp_path, record("arm4", 48))
    assert set(found) <= {"model_explodes"}


HELD = {
    "weld": '<weld body1="target" body2="b"/>',
    "connect": '<connect body1="b" anchor="0 0 -.3"/>',
    "joint": '<joint joint1="hip" joint2="knee" polycoef="0 .2 0 0 0"/>',
}


@pytest.mark.parametrize("name", HELD)
def test_what_an_equality_holds_is_not_judged(name: str, tmp_path: Path) -> None:
    """Nobody recorded its force: a servo that pulls against it moves less than it is told."""
    target = '<body name="target" mocap="true" pos="0 0 .4"/></worldbody>'
    xml = MACHINES["planar"].xml.replace("</worldbody>", target)
    xml = xml.replace("</mujoco>", f"<equality>{HELD[name]}</equality></mujoco>")
    assert kinds(xml, tmp_path, record("planar", 49, robot=xml)) == []


def test_a_model_that_explodes(tmp_path: Path) -> None:
    xml = MACHINES["arm4"].xml.replace('timestep="0.001"', 'timestep="0.02" integrator="Euler"')
    xml = xml.replace("kp=", 'kv="0" kp=').replace(' kv="5"', "").replace(' kv="6"', "")
    xml = xml.replace(' kv="3"', "").replace(' kv="0.6"', "").replace('kp="', 'kp="9')
    assert kinds(xml, tmp_path) == ["model_explodes"]


def test_a_sound_model_alone(tmp_path: Path) -> None:
    for machine in MACHINES.values():
        assert kinds(machine.xml, tmp_path) == []


def test_masses_that_nobody_gave_are_a_note(tmp_path: Path) -> None:
    path = tmp_path / "m.xml"
    path.write_text(re.sub(r' mass="[^"]*"', "", MACHINES["planar"].xml))
    notes = [f.kind for f in check(Scene(path), None).findings if not f.sure]
    assert notes == ["masses_guessed"]


def test_the_order_of_drives_is_a_note(tmp_path: Path) -> None:
    path = tmp_path / "m.xml"
    xml = MACHINES["planar_torque"].xml
    one, other = '<motor name="hip_m" joint="hip"/>', '<motor name="knee_m" joint="knee"/>'
    path.write_text(xml.replace(one + other, other + one))
    notes = [f.kind for f in check(Scene(path), None).findings if not f.sure]
    assert notes == ["actuator_order"]


def test_recordings_alone(tmp_path: Path) -> None:
    r = record("arm4", 45)
    assert not check(None, r).findings
    spoiled = with_columns(r, {"qvel/yaw": -r.columns["qvel/yaw"]})
    assert [f.kind for f in check(None, spoiled).findings] == ["velocity_sign"]


@pytest.mark.parametrize(
    ("given", "mended", "agreed"),
    [
        ([0.0034, 0.0582, 0.0045], [0.0034, 0.0097, 0.0074], False),  # a spring of the shoulder
        ([0.0035, 0.1021, 0.0011], [0.0035, 0.0790, 0.0057], False),
        ([0.0034, 0.0582, 0.0310], [0.0034, 0.0097, 0.0041], True),
    ],
)
def test_a_spring_that_balances_one_joint_compensates_no_other(
    given: list[float], mended: list[float], agreed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two recordings of a shoulder whose spring is as stiff as its weight, and another."""
    beside = Mock(spec=Balance, **{"unexplained_forces.return_value": np.array(mended)})
    monkeypatch.setattr(gravity, "_beside", Mock(return_value=beside))
    balance = Mock(spec=Balance, **{"unexplained_forces.return_value": np.array(given)})
    assert gravity._agreed(balance, Mock(spec=AuditFinding)) is agreed
