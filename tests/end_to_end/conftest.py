"""One small run that every test here looks at, and the means to start and disturb others."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from wt.cli.main import main

STEPS, EVERY = 120, 20
METHODS = (
    "RawSim", "DirectPred", "ResDyn", "ResDynSim", "RSSM", "MeanShiftOT",
    "SimulatorEncoder", "PairedCeiling", "WorldTranslation", "WorldTranslationPlus",
)  # fmt: skip

Wt = Callable[..., tuple[int, str, str]]


@dataclass(frozen=True)
class Place:
    """Where all runs of a session keep what they share.

    Attributes:
        conf: the shipped configurations.
        home: current folder of every command.
        store: URI of the MLflow store.
        words: ``--config`` and overrides of a run as small as can be.
    """

    conf: Path
    home: Path
    store: str
    words: tuple[str, ...]

    @property
    def data(self) -> Path:
        """Where collections are kept."""
        return self.home / "data"


@pytest.fixture(scope="session")
def place(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Place:
    home = tmp_path_factory.mktemp("runs")
    small = {
        "data": {"dir": home / "data", "transitions": 1500, "validation_pairs": 300,
                 "test_pairs": 300},
        "world": {"arms": 8, "episode_steps": 50, "motion.routes": 2, "motion.route_seconds": 5.0},
        "baselines": {"steps": 20},
    }  # fmt: skip
    for method in ("paper", "plus"):
        small[method] = {
            "mean.steps": 40, "train.steps": STEPS, "train.validate_every": EVERY,
            "train.log_every": 10,
        }  # fmt: skip
    words = [f"{section}.{k}={v}" for section, keys in small.items() for k, v in keys.items()]
    config = str(root / "conf" / "debug.yaml")
    return Place(root / "conf", home, f"sqlite:///{home}/mlflow.db", ("--config", config, *words))


@pytest.fixture
def wt(place: Place, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Wt:
    """Runs a command in this process: exit code, stdout, stderr."""
    monkeypatch.chdir(place.home)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", place.store)

    def run(*words: object) -> tuple[int, str, str]:
        code = main([str(word) for word in words])
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture(scope="session")
def finished(place: Place) -> Path:
    """Folder of a run that nothing disturbed, on one worker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place.home)
        patch.setenv("MLFLOW_TRACKING_URI", place.store)
        assert main(["fit", *place.words, "workers=1", "--out", "finished"]) == 0
    return place.home / "finished"


class Started:
    """``wt fit`` in a process and process group of its own."""

    def __init__(self, place: Place, *words: str) -> None:
        code = "import sys; from wt.cli.main import main; sys.exit(main())"
        python_path = os.pathsep.join([str(place.conf.parent), os.environ.get("PYTHONPATH", "")])
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, "fit", *words],
            cwd=place.home,
            env={**os.environ, "MLFLOW_TRACKING_URI": place.store, "PYTHONPATH": python_path},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.pid = self._process.pid

    def wait_until(self, what: Callable[[], bool], seconds: float = 600.0) -> None:
        """Poll until ``what`` holds; fail if the process ends first."""
        end = time.monotonic() + seconds
        while not what():
            if self._process.poll() is not None:
                pytest.fail(f"ended with {self._process.returncode}: {self._process.communicate()}")
            assert time.monotonic() < end, "it takes too long"
            time.sleep(0.005)

    def end(self) -> tuple[int, str, str]:
        """Wait for the process to end: exit code, stdout, stderr."""
        out, err = self._process.communicate(timeout=300)
        return self._process.returncode, out, err

    def left_alone(self) -> bool:
        """Whether all its processes end, given a moment: Python's own tracker ends last."""
        deadline = time.monotonic() + 60.0
        while self.others() and time.monotonic() < deadline:
            time.sleep(0.1)
        return not self.others()

    def others(self) -> list[int]:
        """Processes of its group that are alive, itself left out."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                state, _, group, *_ = stat.read_text().rpartition(")")[2].split()
            except OSError:  # ended meanwhile
                continue
            if int(group) == self.pid != int(stat.parent.name) and state != "Z":
                found.append(int(stat.parent.name))
        return found


@pytest.fixture
def start(place: Place) -> Iterator[Callable[..., Started]]:
    """Starts ``wt fit`` in a process of its own; none outlives its test."""
    started: list[Started] = []

    def begin(*words: str) -> Started:
        started.append(Started(place, *words))
        return started[-1]

    yield begin
    for process in started:
        for pid in (process.pid, *process.others()):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue


@dataclass(frozen=True)
class Tried:
    """The command that README opens with, typed in a fresh clone.

    Attributes:
        clone: the folder it was typed in.
        promised: what README says that it prints.
        printed: what it printed.
    """

    clone: Path
    promised: str
    printed: str

    @property
    def found(self) -> Mapping[str, object]:
        return json.loads((self.clone / "diagnosis" / "diagnosis.json").read_text())  # type: ignore[no-any-return]


@pytest.fixture(scope="session")
def tried(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Tried:
    if not (root / ".git").exists():
        pytest.skip("this is no checkout that could be cloned")
    clone = tmp_path_factory.mktemp("stranger") / "clone"
    subprocess.run(["git", "clone", "--quiet", str(root), str(clone)], check=True)
    block = re.search(r"^```console\n\$ wt (.*?)\n(.*?)^```", readme(clone), re.M | re.S)
    assert block is not None
    words, promised = block.groups()
    done = subprocess.run(
        [f"{sys.executable} -m wt.cli.main {words}"],
        cwd=clone, shell=True, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(clone), "COLUMNS": "80"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return Tried(clone, promised, done.stdout)


def readme(clone: Path) -> str:
    return (clone / "README.md").read_text(encoding="utf-8")
