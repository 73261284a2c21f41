"""What a user's file leaves out is named, and what MuJoCo would take in silence is refused."""

from __future__ import annotations

import warnings
from pathlib import Path

import mujoco
import pytest

from wt.errors import ModelError
from wt.mjcf.edit import patched_xml
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

UNNAMED = """<mujoco>
  <worldbody>
    <body name="trunk"><freejoint/><geom size="0.1"/>
      <body name="leg"><joint name="hip" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2"/>
        <body name="ear"><joint axis="1 0 0"/><geom size="0.05" pos="0 0.2 0"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="hip"/><!-- mine -->
    <position name="actuator0" joint="hip" kp="3"/>
  </actuator>
</mujoco>
"""
PID = """<mujoco><extension><plugin plugin="mujoco.pid"/></extension><actuator>
  <plugin name="w" joint="hip" plugin="mujoco.pid"><config key="kp" value="40"/></plugin>
  </actuator>"""
CLOTH = '<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".1 .1 .1" dim="2" mass=".1"/>'


def refusal(folder: Path, text: str) -> str:
    (folder / "arm.xml").write_text(text)
    with pytest.raises(ModelError) as error:
        Scene(folder / "arm.xml")
    assert "\n" not in str(error.value)
    return str(error.value)


def test_joints_and_actuators_get_names_by_id(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(UNNAMED)
    scene = Scene(tmp_path / "arm.xml")
    given = scene.given
    assert [given.joint(j).name for j in range(3)] == ["joint0", "hip", "joint2"]
    # a name that the user has taken is not given twice
    assert [d.name for d in scene.drives] == ["actuator0_", "actuator0"]
    assert scene.free == ("joint0",)
    at = Location("joint", "joint2")
    viscous = Planted(
        effects()["joint.friction_viscous"], at, effects()["joint.friction_viscous"].steps()
    )
    text = patched_xml(scene, (viscous,), ("found",))
    assert '<motor joint="hip" name="actuator0_"/><!-- mine -->' in text
    model = mujoco.MjModel.from_xml_string(text)
    assert model.joint("joint2").damping[0] == viscous.theta[0]
    assert model.joint("joint0").type[0] == mujoco.mjtJoint.mjJNT_FREE


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<mujoco>", '<!DOCTYPE m [<!ENTITY x "y">]><mujoco>', "has a DTD"),
        ('size="0.05"', 'size="0.05" mass="nan"', 'mass="nan" of <geom>'),
        ("<worldbody>", '<option timestep="0"/><worldbody>', "has a time step of 0 s"),
        (
            '<motor joint="hip"/>',
            '<muscle name="w" joint="hip" lengthrange="0 1"/>',
            "actuator 'w'",
        ),
        ("<mujoco>", PID, "actuator 'w' of"),
        ('<joint axis="1 0 0"/>', '<joint name="e" type="ball"/>', "write it as three hinges"),
        ("</worldbody>", f"{CLOTH}</worldbody>", "flex 'cloth' of"),
        ("</mujoco>", "", "does not compile"),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in UNNAMED
    assert said in refusal(tmp_path, UNNAMED.replace(old, new))


def test_a_refusal_is_all_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Not MuJoCo's warnings of the same as well."""
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refusal(tmp_path, UNNAMED.replace("</worldbody>", f"{CLOTH}</worldbody>"))
    assert capfd.readouterr() == ("", "")
    assert [p.name for p in tmp_path.iterdir()] == ["arm.xml"]


def test_what_mujoco_warns_of_is_said_once_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(UNNAMED.replace("<mujoco>", '<mujoco><compiler settotalmass="2"/>'))
    with pytest.warns(UserWarning) as said:
        Scene(path).given  # noqa: B018
    (line,) = (str(w.message) for w in said)
    assert line.startswith(f"model '{path}': compiler attribute") and "\n" not in line


def test_rigid_flexes_are_taken(tmp_path: Path) -> None:
    rigid = CLOTH.replace("<flexcomp", '<flexcomp rigid="true"')
    (tmp_path / "arm.xml").write_text(UNNAMED.replace("</worldbody>", f"{rigid}</worldbody>"))
    assert Scene(tmp_path / "arm.xml").own_joints == ("hip", "joint2")


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_what_mujoco_reads_is_taken(tmp_path: Path, encoding: str) -> None:
    text = UNNAMED.replace("<mujoco>", '<mujoco model="R&D arm"><!-- Gelenk für -- hinten -->')
    (tmp_path / "arm.xml").write_text(text, encoding=encoding)
    written = patched_xml(Scene(tmp_path / "arm.xml"), (), ())
    assert 'model="R&amp;D arm"' in written
    assert "für -- hinten" in written
    mujoco.MjModel.from_xml_string(written)
