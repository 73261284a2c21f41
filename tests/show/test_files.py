"""Files are the earlier ones or whole new ones, and nobody else's are touched on the way."""

from __future__ import annotations

import io
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest

from wt.errors import UserError, WorkError
from wt.show import files


def half(then: BaseException | type[BaseException], whole: int = 0) -> object:
    """``os.fdopen`` whose files take half of what is written, after so many that take it all."""
    opened = []

    def fdopen(handle: int, mode: str) -> io.BufferedWriter:
        file = open(handle, mode)  # noqa: SIM115 – as os.fdopen
        opened.append(file)
        if len(opened) > whole:
            plain = file.write

            def write(content: bytes) -> int:
                plain(content[: len(content) // 2])
                raise then

            file = type("Half", (io.BufferedWriter,), {"write": staticmethod(write)})(file.raw)
        return file

    return fdopen


@pytest.mark.parametrize("whole", range(2))
def test_an_interruption_leaves_all_earlier_files(
    whole: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files.write_together(tmp_path, {"a": "old a", "b": b"old b"})
    monkeypatch.setattr(files.os, "fdopen", half(KeyboardInterrupt, whole))
    with pytest.raises(KeyboardInterrupt):
        files.write_together(tmp_path, {"a": "new", "b": "new"})
    monkeypatch.undo()
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a": "old a", "b": "old b"}


def test_a_planted_link_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, precious = tmp_path / "out", tmp_path / "precious"
    out.mkdir()
    precious.write_text("mine")
    monkeypatch.setattr(files.secrets, "token_hex", lambda n: "guessed")
    (out / ".a.guessed.part").symlink_to(precious)
    with pytest.raises(FileExistsError):
        files.write_together(out, {"a": "new"})
    assert precious.read_text() == "mine"


def _write_many(folder: Path, text: str) -> None:
    for _ in range(60):
        files.write_together(folder, {"a": text * 5000, "b": text})


def test_two_writers_do_not_collide(tmp_path: Path) -> None:
    writers = [
        multiprocessing.get_context("fork").Process(target=_write_many, args=(tmp_path, text))
        for text in "xy"
    ]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [w.exitcode for w in writers] == [0, 0]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]
    assert len((tmp_path / "a").read_text()) == 5000


def test_a_folder_is_one_process_s_at_a_time(tmp_path: Path) -> None:
    code = "from pathlib import Path; from wt.show.files import kept\n"
    code += f"with kept(Path({str(tmp_path)!r})): pass"
    run = [sys.executable, "-c", code]
    with files.kept(tmp_path):
        with pytest.raises(WorkError, match="another wt process"), files.kept(tmp_path):
            pass
        done = subprocess.run(run, capture_output=True, text=True)
        assert done.returncode and "is being written by another wt process" in done.stderr
    assert subprocess.run(run).returncode == 0


def test_what_cannot_be_written_is_said_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(UserError, match="is a file; name a folder"), files.kept(tmp_path / "file"):
        pass
    with pytest.raises(UserError, match="cannot be written"), files.kept(tmp_path / "file" / "x"):
        pass
    with pytest.raises(KeyError), files.kept(tmp_path / "a" / "b"):
        raise KeyError
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_the_right_to_write_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(UserError, match="cannot be written"), files.kept(tmp_path / "out"):
        pass
