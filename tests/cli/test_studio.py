"""``wt studio``: what it refuses, before it serves anything."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import pytest

from wt.cli.main import main
from wt.show.files import kept
from wt.studio.session import Session


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


def test_two_in_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = Session(tmp_path / "session").folder
    with kept(folder):
        assert main(["studio", "--dir", str(folder)]) == 1
    assert "is being written by another wt process" in capsys.readouterr().err


def test_without_its_extra_one_line_says_which(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "uvicorn", None)
        patch.delitem(sys.modules, "wt.studio.serve", raising=False)
        assert main(["studio"]) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "extra 'studio'" in line and "uvicorn" in line


def test_a_port_that_is_in_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        assert main(["studio", "--dir", str(tmp_path / "new"), "--port", port]) == 2
    assert f"--port {port} is in use" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
