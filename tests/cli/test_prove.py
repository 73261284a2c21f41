"""``wt prove``: arguments, what it prints and leaves, and how it is interrupted and resumed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.prove.test_bench import brought, short
from wt.cli.main import main
from wt.prove import bench, blind, contenders, folder

LEFT = ["answers.json", "cases", "diagnoses", "key", "ledger.json", "manifest.json", "plan.json",
        "report.html", "results.json", "trials.rrd"]  # fmt: skip


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short cases, and the quickest rival in our place."""
    program, closed = contenders.program, contenders.closed
    monkeypatch.setattr(bench, "cases", lambda set, seed: short())
    monkeypatch.setattr(folder, "code", lambda: "this code")
    monkeypatch.setattr(contenders, "program", lambda who, s, *n: program("coulomb", s))
    monkeypatch.setattr(contenders, "closed", lambda who, *f: closed("coulomb", *f))
    monkeypatch.setenv("COLUMNS", "80")


def test_a_trial(quick: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "trial"
    assert main(["prove", "--quick", "--out", str(out), "--jobs", "2"]) == 0
    printed = capsys.readouterr()
    # no terminal, no bar: a plain line every ten seconds
    assert all(" % after " in line for line in printed.err.splitlines())
    assert sorted(path.name for path in out.iterdir()) == LEFT
    rows = {line.rsplit(maxsplit=2)[0].strip(): line.split()[-2:] for line in
            printed.out.splitlines() if line.endswith("%")}  # fmt: skip
    assert rows["right effect                1"] == ["100", "%"]
    assert rows["false alarms                1"] == ["100", "%"]
    assert "missed: false alarms 100.0 %, wanted 0 to 2 %" in printed.out
    assert printed.out.splitlines()[-1] == str(out / "report.html")
    html = (out / "report.html").read_text()
    assert "<svg" in html
    assert "http://" not in html.replace("http://www.w3.org", "")
    assert "003-friction" in html
    assert (out / "trials.rrd").read_bytes()[:3] == b"RRF"
    # the same again: nothing is diagnosed anew, and the score is the same
    before = (out / "results.json").read_text()
    assert main(["prove", "--resume", "--out", str(out), "--jobs", "1"]) == 0
    assert (out / "results.json").read_text() == before


@pytest.mark.long
def test_cases_of_others(quick: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    home, out = tmp_path / "theirs", tmp_path / "trial"
    answers = brought(home)
    assert main(["prove", "--bring", str(home), "--seal", str(answers)]) == 0
    assert f"the key is in {tmp_path / 'theirs.key'}" in capsys.readouterr().out
    assert main(["prove", "--bring", str(home), "--out", str(out), "--jobs", "2"]) == 0
    assert "ask for the key" in capsys.readouterr().out
    assert not (out / "results.json").exists()
    again = ["prove", "--resume", "--out", str(out), "--key"]
    assert main([*again, "ab" * 32]) == 2
    assert "does not open" in capsys.readouterr().err
    assert main([*again, str(tmp_path / "theirs.key")]) == 0
    assert json.loads((out / "results.json").read_text())["brought"] == str(home)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--quick", "--set", "full"], "--quick is a set of its own"),
        (["--set", "ful"], "set of trials 'ful'; allowed: brief, quick, full"),
        (["--only", "arm7"], "--only 'arm7' matches no case of the set 'full'"),
        (["--resume"], "--resume needs --out"),
        (["--resume", "--out", "{t}"], "holds no trial"),
        (["--resume", "--out", "{t}", "--quick"], "name no others"),
        (["--seal", "a.json"], "--seal needs --bring"),
        (["--bring", "{t}", "--set", "full"], "--bring names the cases"),
        (["--bring", "{t}"], "is no manifest of cases"),
        (["--bring", "{t}", "--seal", "a.json"], "has no folder 'cases'"),
        (["--out", "{t}/file"], "is a file; name a folder"),
        (["--out", "{t}"], "is not empty"),
        (["--seed", "-1"], "seed"),
        (["--jobs", "0"], "jobs"),
    ],
)
def test_wrong_arguments_are_one_line_and_exit_2(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setenv("WT_DEBUG", "0")
    (tmp_path / "file").write_text("")
    assert main(["prove", *(word.format(t=tmp_path) for word in words)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.long
def test_ctrl_c_leaves_no_process_and_what_is_finished(tmp_path: Path) -> None:
    out, scratch = tmp_path / "trial", tmp_path / "scratch"
    scratch.mkdir()
    words = ["prove", "--set", "brief", "--only", "pendulum-nothing", "--out", str(out)]
    started = subprocess.Popen(
        [sys.executable, "-m", "wt.cli.main", *words], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
        env={**os.environ, "WT_DEBUG": "0", "TMPDIR": str(scratch)},
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not list(scratch.glob("blind-*/said")) and time.monotonic() < deadline:
        time.sleep(0.1)
    started.send_signal(signal.SIGINT)
    printed, error = started.communicate(timeout=60)
    assert (started.returncode, printed) == (1, "")
    *before, last = error.splitlines()
    assert last.startswith("error: interrupted: nothing finished is lost; continue with: wt prove")
    # on a busy machine there is progress before it, and nothing else
    assert all(" % after " in line for line in before), error
    assert not list(scratch.glob("blind-*"))
    assert (out / "manifest.json").exists()
    assert not (out / "ledger.json").exists()
    assert not list(out.glob("diagnoses/*/*"))
    assert blind.GUARD.exists()
