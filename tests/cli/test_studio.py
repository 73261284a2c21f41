"""``wt studio``: what it refuses, before it serves anything."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from wt.cli.main import main


@pytest.mark.parametrize("name", ["mine", "mine/a.txt"])
def test_a_folder_that_is_not_its_own(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.txt").write_text("mine")
    assert main(["studio", "--dir", str(tmp_path / name)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "name a" in line
    assert [p.name for p in tmp_path.rglob("*")] == ["mine", "a.txt"]


def test_a_port_that_is_in_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        assert main(["studio", "--dir", str(tmp_path / "new"), "--port", port]) == 2
    assert f"--port {port} is in use" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
