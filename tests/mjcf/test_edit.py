"""The patched MJCF is the user's own text with changes only where something was found."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.mjcf.edit import diff, patched_xml
from wt.mjcf.standalone import compiles_to, standalone
from wt.physics.effect import Effect, Parameter, Shape, effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

ARM = """<mujoco model="arm">
  <!-- my arm -- for MuJoCo -->
  <compiler angle="degree" eulerseq="zyx"/>
  <option timestep="0.002"
          integrator="implicitfast"/>   <!-- keep me -->
  <default>
    <default class="big"><joint damping="0.5" armature="0.01"/><position kp="30" kv="2"/></default>
  </default>
  <worldbody>
    <body name="upper" childclass="big">
      <joint name="j1" axis="0 1 0"  range="-90 90" springref="10" stiffness="2"/>  <!-- why -->
      <geom size="0.1"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
      <body name="lower" euler="10 20 0"><joint name='j2'/><geom size=".05" mass=".3"/></body>
    </body>
  </worldbody>
  <actuator>
    <position name="m1" joint="j1" class="big"/>
    <motor name="m2" joint="j2"/>
  </actuator>
</mujoco>
"""
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def planted(effect: str, kind: str, name: str, *theta: float) -> Planted:
    return Planted(effects()[effect], Location(kind, name), np.array(theta))  # type: ignore[arg-type]


class Dry(Effect):
    """Changes exactly one attribute, whatever the library's effects do."""

    id = "joint.dry"
    kind = "joint"
    parameters = (Parameter("coulomb", "N·m", 0.0, 10.0, 1e-3),)
    reference = ""

    def columns(self, motion: Motion, at: Location, shape: Shape) -> np.ndarray:
        return np.zeros((*motion.q.shape, 1))

    def theta(self, coefficients: np.ndarray, shape: Shape) -> np.ndarray:
        return coefficients

    def patch(self, spec: mujoco.MjSpec, at: Location, theta: np.ndarray) -> None:
        spec.joint(at.name).frictionloss += theta[0]

    def statement(self, at: Location, theta: np.ndarray) -> str:
        return "dry"


def dry(joint: str, coulomb: float) -> Planted:
    return Planted(Dry(), Location("joint", joint), np.array([coulomb]))


def scene_of(folder: Path, text: str, name: str = "arm.xml") -> Scene:
    (folder / name).write_text(text)
    return Scene(folder / name)


def patched(scene: Scene, *hypothesis: Planted, said: Sequence[str] = ("found",)) -> str:
    return patched_xml(scene, hypothesis, said)


def loaded_elsewhere(text: str, folder: Path) -> mujoco.MjModel:
    """Compile as a user would who got the file in another folder."""
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(text)
    return mujoco.MjModel.from_xml_path(str(folder / "model.xml"))


def test_nothing_found_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    assert patched(scene_of(tmp_path, ARM), said=()) == ARM


def test_one_attribute_is_added_under_a_comment_and_no_other_byte_changes(tmp_path: Path) -> None:
    text = patched(
        scene_of(tmp_path, ARM),
        dry("j1", 1.25),
        said=["It loses 1.25 N·m -- dry."],
    )
    expected = ARM.replace(
        '      <joint name="j1" axis="0 1 0"  range="-90 90" springref="10" stiffness="2"/>',
        "      <!-- wt diagnose: It loses 1.25 N·m - - dry. -->\n"
        '      <joint name="j1" axis="0 1 0"  range="-90 90" springref="10" stiffness="2"'
        ' frictionloss="1.25"/>',
    )
    assert text == expected


def test_angles_are_written_in_the_users_unit(tmp_path: Path) -> None:
    text = patched(scene_of(tmp_path, ARM), planted("joint.stop", "joint", "j1", np.pi / 4, 1.0))
    assert 'range="-90 45"' in text
    model = loaded_elsewhere(text, tmp_path / "out")
    np.testing.assert_allclose(model.joint("j1").range, [-np.pi / 2, np.pi / 4])


def test_what_a_class_gives_is_overridden_only_at_the_element_found(tmp_path: Path) -> None:
    text = patched(scene_of(tmp_path, ARM), planted("actuator.gain", "actuator", "m1", 0.5))
    model = loaded_elsewhere(text, tmp_path / "out")
    assert model.actuator("m1").gainprm[0] == 15.0
    assert model.actuator("m1").biasprm[:3].tolist() == [0.0, -15.0, -1.0]
    assert '<default class="big"><joint damping="0.5" armature="0.01"/><position kp="30"' in text


def test_every_sentence_stands_at_its_own_element(tmp_path: Path) -> None:
    lines = patched(
        scene_of(tmp_path, ARM),
        dry("j1", 1.25),
        planted("actuator.delay", "actuator", "m1", 0.01),
        planted("joint.friction_viscous", "joint", "j1", 0.25),
        planted("sensor.offset", "joint", "j2", 0.1),
        said=["sticky", "late", "viscous", "askew"],
    ).splitlines()
    joint = next(i for i, line in enumerate(lines) if 'name="j1"' in line)
    assert [line.strip() for line in lines[joint - 2 : joint]] == [
        "<!-- wt diagnose: sticky -->",
        "<!-- wt diagnose: viscous -->",
    ]
    motor = next(i for i, line in enumerate(lines) if 'name="m1"' in line)
    assert lines[motor - 1] == "    <!-- wt diagnose: late -->"
    # MuJoCo has no word for an encoder's offset: it is said at the head
    assert lines[1].startswith("  <!-- wt diagnose: askew (MuJoCo has no element for it")


def test_new_elements_stand_where_they_belong(tmp_path: Path) -> None:
    text = patched(
        scene_of(tmp_path, ARM), planted("body.payload_fixed", "body", "lower", 2.0, 0.1, 0.0, 0.0)
    )
    model = loaded_elsewhere(text, tmp_path / "out")
    assert model.body_subtreemass[model.body("lower").id] == pytest.approx(2.3)
    lines = [line.strip() for line in text.splitlines()]
    added = lines.index("<!-- wt diagnose: found -->")
    assert lines[added - 1].startswith('<body name="lower"')
    assert lines[added + 1].startswith('<body name="lower_payload" pos="0.1 0 0"')
    assert set(ARM.splitlines()) - set(text.splitlines()) == {
        '      <body name="lower" euler="10 20 0"><joint name=\'j2\'/>'
        '<geom size=".05" mass=".3"/></body>'
    }


def test_a_refined_time_step_is_written_and_said(tmp_path: Path) -> None:
    text = patched_xml(scene_of(tmp_path, ARM), (), (), timestep=5e-4)
    assert (
        "  <!-- wt diagnose: time step refined from 2 ms to 0.5 ms, as the recordings need. -->\n"
        '  <option timestep="0.0005"\n'
        '          integrator="implicitfast"/>   <!-- keep me -->\n'
    ) in text
    without = ARM.replace('  <option timestep="0.002"\n          integrator="implicitfast"/>', "")
    text = patched_xml(scene_of(tmp_path, without, "b.xml"), (), (), timestep=5e-4)
    assert loaded_elsewhere(text, tmp_path / "out").opt.timestep == 5e-4


@pytest.mark.parametrize("name", list(effects()))
def test_every_effect_can_be_written_into_the_users_text(name: str, tmp_path: Path) -> None:
    """The text compiles to the patched spec's numbers, with every line of the user's in it."""
    floor = '<worldbody>\n    <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -2"/>'
    scene, effect = scene_of(tmp_path, ARM.replace("<worldbody>", floor)), effects()[name]
    lower, upper = effect.bounds()
    theta = np.clip(lower + 0.37 * np.minimum(upper - lower, 1.0), lower, upper)
    at = effect.places(scene)[0]
    text = patched_xml(scene, (Planted(effect, at, theta),), ("found",))
    spec = scene.spec()
    effect.patch(spec, at, theta)
    assert compiles_to(text, spec.compile())
    assert "<!-- my arm -- for MuJoCo -->" in text and "<!-- keep me -->" in text
    assert "<!-- wt diagnose: found" in text
    assert "own writing" not in text


def test_what_mujoco_expands_is_written_by_mujoco(tmp_path: Path) -> None:
    given = """<mujoco><worldbody><replicate count="2" offset="1 0 0" sep="_">
      <body name="b"><joint name="j"/><geom size="0.1"/></body></replicate></worldbody></mujoco>"""
    text = patched(scene_of(tmp_path, given), dry("j_1", 0.5))
    model = loaded_elsewhere(text, tmp_path / "out")
    assert model.joint("j_1").frictionloss[0] == 0.5 and model.joint("j_0").frictionloss[0] == 0.0
    assert "MuJoCo's own writing" in text and "<!-- wt diagnose: found -->" in text


@pytest.fixture
def split_robot(tmp_path: Path) -> Path:
    """A scene that includes a robot with a mesh, as collections of models have them."""
    robot = tmp_path / "robot"
    (robot / "assets").mkdir(parents=True)
    (robot / "assets" / "link.obj").write_text(MESH)
    (robot / "robot.xml").write_text(
        '<mujoco model="robot">\n  <compiler meshdir="assets" angle="radian"/>\n'
        '  <asset><mesh file="link.obj"/></asset>\n  <worldbody>\n    <body name="b">\n'
        '      <joint name="j" range="-1 1"/>  <!-- elbow -->\n'
        '      <geom type="mesh" mesh="link" mass="1"/>\n    </body>\n  </worldbody>\n</mujoco>\n'
    )
    (robot / "scene.xml").write_text(
        '<mujoco model="scene">\n  <include file="robot.xml"/>\n  <worldbody>\n'
        '    <geom type="plane" size="1 1 .1"/>\n  </worldbody>\n</mujoco>\n'
    )
    return robot / "scene.xml"


def test_includes_and_meshes_resolve_from_another_folder(
    split_robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(split_robot.parent.parent)
    scene = Scene(os.path.relpath(split_robot))
    text = patched(scene, dry("j", 0.5))
    monkeypatch.chdir("/")
    model = loaded_elsewhere(text, tmp_path / "far" / "away")
    assert model.nmesh == 1 and model.joint("j").frictionloss[0] == 0.5
    assert '<joint name="j" range="-1 1" frictionloss="0.5"/>  <!-- elbow -->' in text
    # and the same when nothing is found, up to the finding
    nothing = patched(Scene(split_robot), said=())
    assert loaded_elsewhere(nothing, tmp_path / "none").nmesh == 1
    assert nothing == standalone(split_robot)
    changed = [x for x in diff(nothing, text).splitlines()[2:] if x[0] in "+-"]
    assert len(changed) == 3


def test_assets_beside_the_model_get_their_folder_written(tmp_path: Path) -> None:
    (tmp_path / "link.obj").write_text(MESH)
    given = """<mujoco>
  <asset><mesh file="link.obj"/></asset>
  <worldbody><body><joint name="j"/><geom type="mesh" mesh="link"/></body></worldbody>
</mujoco>"""
    text = patched(scene_of(tmp_path, given), said=())
    assert loaded_elsewhere(text, tmp_path / "out").nmesh == 1
    assert set(given.splitlines()) <= set(text.splitlines())


def test_a_model_with_other_numbers_does_not_pass(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    assert compiles_to(ARM, model)
    assert not compiles_to(ARM.replace('mass=".3"', 'mass=".3001"'), model)
    assert not compiles_to(ARM.replace('range="-90 90"', 'range="-90 89.9"'), model)
    assert not compiles_to(ARM.replace("</mujoco>", ""), model)


def test_diff_shows_what_changed(tmp_path: Path) -> None:
    text = patched(scene_of(tmp_path, ARM), dry("j2", 1.0))
    lines = diff(ARM, text, "arm.xml").splitlines()
    assert lines[:2] == ["--- given/arm.xml", "+++ patched/arm.xml"]
    assert any(line.startswith("+") and 'frictionloss="1"' in line for line in lines)
