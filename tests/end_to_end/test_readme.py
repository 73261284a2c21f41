"""README's commands run, line by line, in a fresh clone: each that it shows.

What would take hours, the network or a robot is run in another form, which stands in ``INSTEAD``.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from tests.data.importers.test_ros2 import MULTI, STATE, header, make, ms, multi, write_mcap
from tests.end_to_end.conftest import Place, Tried
from wt.data.recording import read

ROOT = Path(__file__).parents[2]
RUN = "runs/r5_force-2026-11-21T10-00-00"
"""The folder of a run as README names it."""

INSTEAD = {
    # the network
    "make env": "make -n env",
    "pip install .": "pip install -q --dry-run --no-index --no-deps --no-build-isolation .",
    "pip install '.[fit]'": "pip install -q --dry-run --no-index --no-deps --no-build-isolation "
    "'.[fit]'",
    "make docs": "make -n docs",
    # minutes: stranger.sh does it
    "make demo": "make -n demo",
    "wt demo": "wt demo --help",
    # minutes and hours: the run of the other tests here is this one, as small as can be
    "wt fit --config debug": f"test -s {RUN}/results.json",
    "wt fit --config r5 seeds=[0,1,2]": "wt fit --config r5 seeds=[0,1,2] --help",
    # a model that takes 20 minutes: tests/finetune has a small one
    "wt-finetune --config finetune_go2": "wt-finetune --config finetune_go2 --help",
    # a window
    f"wt view {RUN}": f"wt view {RUN} --serve",
    "wt view diagnosis": "wt view diagnosis --serve",
    # bash stays, to be seen as the shell
    "wt --install-completion": "wt --install-completion && true",
}
"""Command of README → what is run in its place, for want of what stands above it."""
SERVERS = ("wt studio", "wt view")
"""They serve a page until Ctrl-C."""
ROBOT, RUNNER = "wt-sim-go2", "wt-run --robot go2 --policy go2"
"""Two that need each other."""
LONG = {
    "wt diagnose robot.xml sweep.parquet --holdout reach.parquet --out diagnosis",
    """python -c 'import wt; wt.diagnose("robot.xml", ["sweep.parquet"]).show()'""",
    "pip install .", "pip install '.[fit]'", "wt verify diagnosis", "wt studio",
    "wt registry list", RUNNER,
}  # fmt: skip
"""Left to ``make test-long``: other tests do nearly the same, and these take seconds each."""


def shown() -> list[str]:
    """Commands of README, each once: of its blocks for the shell, then in its text."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = []
    for block in re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S):
        for line in block.splitlines():
            command, _, comment = line.partition(" #")
            found += [command.strip(), *re.findall(r"\bor (wt \w+)", comment)]
    for code in re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)):
        if code.startswith("wt.diagnose("):
            found.append(f"python -c 'import wt; {code}'")
        # two words name a command, they do not show it
        elif re.match(r"make |python |wt --|wt \S+ \S", code):
            found.append(code)
    return [command for command in dict.fromkeys(found) if command]


CASES = [
    pytest.param(line, marks=[pytest.mark.long] * (line in LONG))
    for line in shown()
    if line != ROBOT
]


@pytest.fixture(scope="module")
def folder(tried: Tried, place: Place, finished: Path) -> Path:
    """A clone with what README names: a robot, its logs, a diagnosis and a run."""
    clone, arm = tried.clone, tried.clone / "examples" / "arm"
    shutil.copy(arm / "model.xml", clone / "robot.xml")
    for take, name in (("1", "sweep"), ("2", "reach")):
        write_log(read(arm / f"{take}.parquet").columns, clone / f"{name}.mcap")
    (clone / RUN).parent.mkdir(exist_ok=True)
    shutil.copytree(finished, clone / RUN)
    shutil.copy(place.home / "mlflow.db", clone)
    return clone


def write_log(columns: Mapping[str, np.ndarray], path: Path) -> None:
    """What a ROS 2 node of the arm logs, 100 times a second."""
    log = []
    table = zip(*(columns[f"{kind}/shoulder"] for kind in ("qpos", "qvel", "ctrl")), strict=True)
    for k, (q, v, u) in enumerate(table):
        none, now = np.array([]), ms(10 * k)
        state = make(
            STATE, header=header(now), name=["shoulder"], position=np.array([q]),
            velocity=np.array([v]), effort=none,
        )  # fmt: skip
        log += [("/joint_states", STATE, now, state), ("/arm/commands", MULTI, now, multi(u))]
    write_mcap(path, log)


@pytest.fixture(scope="module")
def shell(folder: Path) -> Iterator[dict[str, str]]:
    """The environment that commands are typed in, with a home of its own."""
    home = folder.parent / "home"
    home.mkdir()
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    yield {**os.environ, "PATH": path, "PYTHONPATH": str(folder), "HOME": str(home)}


def typed(command: str, folder: Path, shell: Mapping[str, str]) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen(
        ["bash", "-c", command if re.search("[>&]", command) else f"exec {command}"],
        cwd=folder, env=shell, stdin=pipe, stdout=pipe, stderr=pipe, text=True,
    )  # fmt: skip


@pytest.mark.parametrize("command", CASES)
def test_a_command_of_readme_runs(command: str, folder: Path, shell: Mapping[str, str]) -> None:
    if command == RUNNER:
        return stands_up(folder, shell)
    process = typed(INSTEAD.get(command, command), folder, shell)
    if command.startswith(SERVERS):
        serves(process)
    _, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    for product in re.findall(r"(?:--to|--out|>) (\S+)", command):
        assert (folder / product).exists()


def test_nothing_stands_in_the_tables_that_readme_does_not_show() -> None:
    assert {*INSTEAD, *LONG, ROBOT, RUNNER} <= set(shown())


def serves(process: subprocess.Popen[str]) -> None:
    """Its page answers; then Ctrl-C."""
    assert process.stdout is not None
    address = process.stdout.readline().strip().partition("?")[0]
    assert urllib.request.urlopen(address, timeout=60).status == 200
    process.send_signal(signal.SIGINT)


def stands_up(folder: Path, shell: Mapping[str, str]) -> None:
    """By the keys that README names; what it prints last can be typed."""
    domain = f"--domain {os.getpid() % 200 + 1}"  # nobody else's robot
    robot = typed(f"{ROBOT} {domain}", folder, shell)
    run = typed(f"{RUNNER} {domain} stale_state=2 deadline=2", folder, shell)
    assert run.stdin is not None and run.stderr is not None
    try:
        for key, seconds in (("1", 3.5), ("2", 2.0), ("x", 0.0)):
            while key == "1" and "waiting" not in run.stderr.readline():
                assert run.poll() is None
            time.sleep(1.0 if key == "1" else 0.0)
            run.stdin.write(key)
            run.stdin.flush()
            time.sleep(seconds)
        out, err = run.communicate(timeout=60)
    finally:
        robot.terminate()
        robot.communicate(timeout=60)
    assert run.returncode == 0, err
    said = out.splitlines()[-1]
    assert re.match(r"wt diagnose (\S+) (\S+) --out", said)
    for file in said.split()[2:4]:
        assert (folder / file).is_file()
