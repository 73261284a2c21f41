"""``wt model`` gives the MJCFs of the package, which plain MuJoCo loads."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from wt.cli.main import main
from wt.worlds.robots import ROBOTS


@pytest.mark.parametrize("name", ROBOTS)
def test_the_mjcf_that_is_printed_is_of_the_robot(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["model", name]) == 0
    model = mujoco.MjModel.from_xml_string(capsys.readouterr().out)
    names = {model.actuator(i).name for i in range(model.nu)}
    assert set(ROBOTS[name].joints) == names and model.joint("base").type[0] == 0


def test_a_file_that_exists_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "go2.xml"
    assert main(["model", "go2", "--to", str(path)]) == 0
    before = path.read_text()
    assert main(["model", "go2", "--to", str(path)]) == 2
    assert path.read_text() == before and "exists" in capsys.readouterr().err


def test_a_robot_that_is_not_there_is_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "go3"]) == 2
    assert "did you mean 'go2'" in capsys.readouterr().err
