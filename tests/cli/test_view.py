"""``wt view``: what it opens, what it refuses, and that the web viewer really answers."""

import os
import re
import signal
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rerun as rr

from wt.cli import view
from wt.errors import UserError


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A run's folder with a tiny rollout in it."""
    stream = rr.RecordingStream("test")
    memory = stream.memory_recording()
    stream.log("point", rr.Points3D([[0.0, 0.0, 0.0]]))
    (tmp_path / "rollout.rrd").write_bytes(memory.drain_as_bytes())
    return tmp_path


def test_a_folder_means_its_rollout(recording: Path) -> None:
    assert view.recording_of(recording) == recording / "rollout.rrd"
    assert view.recording_of(recording / "rollout.rrd") == recording / "rollout.rrd"


def test_the_folder_of_a_diagnosis_means_its_recording(recording: Path) -> None:
    found = (recording / "rollout.rrd").rename(recording / "diagnosis.rrd")
    assert view.recording_of(recording) == found


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", r"holds none of rollout\.rrd, diagnosis\.rrd, trials\.rrd; give"),
        ("nothing.rrd", r"nothing\.rrd does not exist; give"),
    ],
)
def test_a_missing_file_is_named(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(UserError, match=message) as error:
        view.recording_of(tmp_path / name)
    assert error.value.exit_code == 2
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"", b"RR", b"PAR1 something else"])
def test_a_foreign_or_truncated_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.rrd"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"x\.rrd is not a Rerun recording"):
        view.recording_of(path)


def test_the_viewers_exit_code_is_not_lost(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view, "_viewer", lambda path: [sys.executable, "-c", "raise SystemExit(3)"])
    with pytest.raises(view.WorkError, match="code 3"):
        view.command(recording)


@pytest.fixture
def served(recording: Path, tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A running ``--serve`` with a home of its own, and that home."""
    home = tmp_path / "home"
    home.mkdir()
    env = {k: v for k, v in os.environ.items() if k not in ("CI", "XDG_CONFIG_HOME")}
    env |= {"HOME": str(home), "XDG_DATA_HOME": str(home / "data")}
    code = (
        "import pathlib, sys\n"
        "from wt.cli import view\n"
        "view.command(pathlib.Path(sys.argv[1]), serve=True)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(recording)],
        stdout=subprocess.PIPE, text=True, env=env, start_new_session=True,
    )  # fmt: skip
    yield process, home
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def interrupt(process: subprocess.Popen[str]) -> None:
    """Ctrl-C reaches every process of a terminal."""
    os.killpg(process.pid, signal.SIGINT)


@pytest.mark.parametrize("end", [interrupt, subprocess.Popen.terminate], ids=["Ctrl-C", "kill"])
def test_serve_answers_at_the_printed_url_until_it_is_ended(
    served: tuple[subprocess.Popen[str], Path], end: Callable[[subprocess.Popen[str]], None]
) -> None:
    process, home = served
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    assert re.match(r"http://localhost:\d+/\?", url)
    query = urllib.parse.parse_qs(urllib.parse.urlsplit(url).query)
    assert query["notebook"] == ["1"]
    assert query["url"][0].startswith("rerun+http://localhost:")
    with urllib.request.urlopen(url, timeout=10) as page:
        assert b"rerun" in page.read().lower()

    end(process)
    assert process.wait(timeout=20) == 0
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url, timeout=5)
    # usage statistics would wait to be sent in a file of this folder
    assert not list(home.rglob("analytics/*.json"))
