"""A bundled MJCF loads where the user's folders are not."""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from wt.errors import ModelError
from wt.mjcf.bundle import ASSETS, bundled
from wt.mjcf.standalone import compiles_to, standalone

BOX = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BODY = '<body pos="0 0 {}"><joint name="j{}"/><geom type="mesh" mesh="{}" mass="1"/></body>'


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """Two meshes of one name in different folders, and a texture in a third."""
    folder = tmp_path / "robot"
    for name, size in (("left", 1), ("right", 2)):
        (folder / "meshes" / name).mkdir(parents=True)
        (folder / "meshes" / name / "link.obj").write_text(BOX.format(size))
    (folder / "pictures").mkdir()
    Image.fromarray(np.full((4, 4, 3), 90, np.uint8)).save(folder / "pictures" / "wood.png")
    (folder / "robot.xml").write_text(
        '<mujoco>\n  <compiler meshdir="meshes" texturedir="pictures"/>\n  <asset>\n'
        '    <mesh name="a" file="left/link.obj"/>\n    <mesh name="b" file="right/link.obj"/>\n'
        '    <mesh file="left/link.obj" scale="3 3 3"/>\n'
        '    <texture name="wood" type="2d" file="wood.png"/>\n  </asset>\n'
        f"  <worldbody>{BODY.format(0, 1, 'a')}{BODY.format(4, 2, 'b')}{BODY.format(9, 3, 'link')}"
        "</worldbody>\n</mujoco>\n"
    )
    return folder / "robot.xml"


def unpacked(files: dict[str, bytes], folder: Path) -> Path:
    """A folder with the copies."""
    (folder / ASSETS).mkdir(parents=True)
    for name, content in files.items():
        (folder / ASSETS / name).write_bytes(content)
    return folder


def test_assets_of_one_name_stay_two(robot: Path, tmp_path: Path) -> None:
    truth = mujoco.MjModel.from_xml_path(str(robot))
    text, files = bundled(standalone(robot))
    assert sorted(files) == ["link.obj", "link_2.obj", "wood.png"]
    shutil.rmtree(robot.parent)
    assert compiles_to(text, truth, unpacked(files, tmp_path / "there"))
    assert str(tmp_path) not in text


def test_what_has_no_files_stays_as_it_is() -> None:
    text = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    assert bundled(text) == (text, {})


def test_an_attached_model_is_bundled_too(robot: Path, tmp_path: Path) -> None:
    outer = robot.parent / "outer.xml"
    outer.write_text(
        '<mujoco>\n  <asset><model name="r" file="robot.xml"/></asset>\n  <worldbody>\n'
        '    <body><attach model="r" body="inner" prefix="r_"/></body>\n  </worldbody>\n</mujoco>\n'
    )
    robot.write_text(robot.read_text().replace('<body pos="0 0 0">', '<body name="inner">'))
    truth = mujoco.MjModel.from_xml_path(str(outer))
    text, files = bundled(standalone(outer))
    assert sorted(files) == ["link.obj", "link_2.obj", "robot.xml", "wood.png"]
    shutil.rmtree(robot.parent)
    assert compiles_to(text, truth, unpacked(files, tmp_path / "there"))
    assert not any(str(tmp_path).encode() in content for content in files.values())


def test_a_missing_asset_is_one_line(robot: Path) -> None:
    text = standalone(robot)
    (robot.parent / "pictures" / "wood.png").unlink()
    with pytest.raises(ModelError, match=r"--bundle: asset .*wood\.png cannot be read"):
        bundled(text)
