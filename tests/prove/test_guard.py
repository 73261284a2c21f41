"""Who diagnoses reaches nothing but its own files, and no leak changes what it says."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from wt.prove import blind, contenders, guard
from wt.prove.bench import alias, make_one
from wt.prove.cases import Case, cases
from wt.prove.seal import new_key
from wt.prove.sensing import Sensing

SEED, WRONG = "424242", "wrong-answer"

PROBE = """
import json, os, pathlib, socket, subprocess, sys
secret, generator, wall = json.load(open("where.json"))
def attempt(what):
    try:
        what()
        return "got"
    except Exception as error:
        return type(error).__name__
found = {
    "own": attempt(lambda: open("own.txt").read()),
    "key": attempt(lambda: open(secret).read()),
    "key by number": attempt(lambda: os.read(os.open(secret, os.O_RDONLY), 9)),
    "source": attempt(lambda: pathlib.Path(generator, "cases.py").read_text()),
    "import": attempt(lambda: __import__("wt.prove.cases")),
    "parent": attempt(lambda: open(f"/proc/{os.getppid()}/cmdline").read()),
    "surroundings": attempt(lambda: open(f"/proc/{os.getppid()}/environ").read()),
    "process": attempt(lambda: subprocess.run(["cat", secret], check=True, stderr=-3)),
    "environment": sorted(os.environ),
}
if wall:  # more than the hook can do
    found["elsewhere"] = attempt(lambda: open(secret + ".copy").read())
    found["write"] = attempt(lambda: open(secret + ".new", "w"))
    found["network"] = attempt(lambda: socket.create_connection(("127.0.0.1", 9)))
else:  # names are listed so that packages are found
    found["list"] = attempt(lambda: os.listdir(generator))
json.dump(found, open("found.json", "w"))
"""
REFUSED = {"PermissionError", "ModuleNotFoundError", "CalledProcessError"}


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A trial's folder with a key, which is copied beside it too."""
    folder = tmp_path / "trial"
    folder.mkdir()
    (folder / "key").write_text(SEED)
    (folder / "key.copy").write_text(SEED)
    return folder / "key"


def probed(secret: Path, home: Path, walls: str) -> dict[str, Any]:
    """What a probe gets hold of behind a part of the guard, given as Python."""
    home.mkdir()
    (home / "own.txt").write_text("mine")
    where = [str(secret), str(blind.GENERATOR), "wall" in walls]
    (home / "where.json").write_text(json.dumps(where))
    code = (
        f"import runpy, sys; g = runpy.run_path({str(blind.GUARD)!r})\n{walls}\n"
        f"sys.path.insert(0, {str(blind.ROOT)!r})\n{PROBE}"
    )
    command = [sys.executable, "-I", "-c", code]
    subprocess.run(command, cwd=home, env=blind.environment(home), check=True, timeout=60)
    found: dict[str, Any] = json.loads((home / "found.json").read_text())
    return found


@pytest.mark.parametrize("wall", [True, False])
def test_nothing_but_its_own_can_be_reached(secret: Path, tmp_path: Path, wall: bool) -> None:
    """By either half of the guard."""
    if wall and guard.strength() != "landlock":
        pytest.skip("this kernel has no Landlock: only the audit hook keeps the wall")
    home, closed = tmp_path / "home", [str(blind.GENERATOR), str(secret.parent)]
    walls = f"g['wall']({str(blind.ROOT)!r}, {str(home)!r}, {closed})"
    found = probed(secret, home, walls if wall else f"g['watch']({closed})")
    assert found.pop("own") == "got"
    assert set(found.pop("environment")) <= {*blind.environment(tmp_path), "LC_CTYPE"}
    assert set(found.values()) <= REFUSED, found


def test_without_a_guard_everything_can_be_reached(secret: Path, tmp_path: Path) -> None:
    found = probed(secret, tmp_path / "home", "")
    assert found.pop("environment")
    assert set(found.values()) == {"got"}, found


def small() -> Case:
    """A pendulum with friction, seen for two and a half seconds."""
    case = next(c for c in cases("full") if "pendulum-joint.friction_viscous" in c.name)
    sensing = Sensing(rate=100.0, bits=17, noise=1e-4, qvel="none")
    return dataclasses.replace(case, sensing=sensing, seconds=2.5)


def diagnosed(trial: Path, name: str) -> dict[str, bytes]:
    """What ``wt diagnose`` says of a case, run as the trials do."""
    said = trial / "said"
    closed = contenders.closed(contenders.OURS, trial)
    program = contenders.program(contenders.OURS, 600.0)
    job = blind.DiagnosisJob(trial / "cases" / name, said, program, closed, 600.0)
    ((_, ran),) = blind.run([job], 1)
    assert ran.error == ""
    return {file: (said / file).read_bytes() for file in ("diagnosis.json", "model.xml")}


def unstamped(files: dict[str, bytes]) -> dict[str, object]:
    """The files of a diagnosis without its digests: that of the Rerun recording has the time."""
    said = json.loads(files["diagnosis.json"])
    del said["sha256"]
    return {**files, "diagnosis.json": said}


@pytest.mark.long
def test_a_wrong_key_and_a_leaked_seed_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, key = small(), new_key()
    name = alias(case.name, key)
    plain, planted = tmp_path / "plain", tmp_path / "planted"
    for trial in (plain, planted):
        make_one(case, trial / "cases", key)
    expected = diagnosed(plain, name)
    lie = json.dumps({"truth": [{"effect": WRONG}], "seed": SEED, "name": case.name})
    for folder in (planted, planted / "cases", planted / "cases" / name, tmp_path):
        for file in ("answers.json", "answer.json", "seed", "key", "plan.json"):
            (folder / file).write_text(lie)
    for variable in ("WT_SEED", "WT_ANSWERS", "WT_KEY", "SEED", "PYTHONHASHSEED"):
        monkeypatch.setenv(variable, SEED)
    monkeypatch.chdir(planted)
    assert unstamped(diagnosed(planted, name)) == unstamped(expected)
    assert json.loads(expected["diagnosis.json"])["findings"]


def test_what_takes_too_long_is_ended_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, key, scratch = small(), new_key(), tmp_path / "scratch"
    make_one(case, tmp_path / "cases", key)
    home, said = tmp_path / "cases" / alias(case.name, key), tmp_path / "said"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))

    def sleeps(fit: Sequence[str], holdout: Sequence[str]) -> list[str]:
        return ["timeit", "-n1", "-r1", "import time; time.sleep(60)"]

    ((_, ran),) = blind.run([blind.DiagnosisJob(home, said, sleeps, (), 2.0)], 1)
    assert ran.error == "ended after 2 s"
    assert [path.name for path in said.iterdir()] == [blind.RAN]
    assert not list(scratch.iterdir())


def test_an_interrupt_while_a_process_starts_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch, case, started = (
        tmp_path / "scratch",
        tmp_path / "case",
        list[subprocess.Popen[bytes]](),
    )
    scratch.mkdir()
    case.mkdir()
    (case / "robot.xml").write_text("<mujoco/>")
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    popen = subprocess.Popen

    def interrupted(command: list[str], **how: object) -> subprocess.Popen[bytes]:
        started.append(popen(command, **how))  # type: ignore[call-overload]
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)  # the signal is there before the process is known to anybody
        return started[-1]

    def sleeps(fit: Sequence[str], holdout: Sequence[str]) -> list[str]:
        return ["timeit", "-n1", "-r1", "import time; time.sleep(60)"]

    monkeypatch.setattr(blind.subprocess, "Popen", interrupted)
    with pytest.raises(KeyboardInterrupt):
        list(blind.run([blind.DiagnosisJob(case, tmp_path / "said", sleeps, (), 60.0)], 1))
    assert started[0].poll() == -signal.SIGKILL
    assert not list(scratch.iterdir())
