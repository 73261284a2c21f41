"""What a run leaves when the runner, and even the process that keeps it, are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest

from deploy.cli.run import main
from deploy.record import LOG, RECORDING
from deploy.scribe import JOURNAL
from wt.data.recording import read

RUNNER = """
import sys, time
from pathlib import Path
import numpy as np
from deploy.record import Recorder
from deploy.robot import Command
from deploy.scribe import scribe

recorder, one = Recorder(["qpos/hip"], ["hip"], ("stage",)), np.ones(1)
print(scribe(Path(sys.argv[1]), recorder, {"robot": "go2"}).pid, flush=True)
while True:
    now = time.monotonic()
    recorder.row(now, now, np.sin(now * one), Command(one, one, one), (2.0,))
    time.sleep(0.002)
"""


class Run:
    """A runner and its scribe."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-c", RUNNER, str(folder)]
        self.runner = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.runner.stdout is not None
        self.scribe = int(self.runner.stdout.readline())
        self.journal = folder / JOURNAL

    def wait_for(self, seconds: float) -> None:
        """Until so much is on the disk: four numbers and the stage, every two milliseconds."""
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            if self.journal.is_file() and self.journal.stat().st_size > 250 * 8 * 5 * seconds:
                return
            time.sleep(0.05)
        raise AssertionError("the scribe writes nothing")

    def kill(self, both: bool) -> float:
        """SIGKILL; when [s]."""
        if both:
            os.kill(self.scribe, signal.SIGKILL)
        now = time.monotonic()
        self.runner.kill()
        self.runner.wait()
        while both and psutil.pid_exists(self.scribe):  # until it has let go of its files
            if psutil.Process(self.scribe).status() == psutil.STATUS_ZOMBIE:
                break
            time.sleep(0.01)
        return now


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    started = Run(tmp_path)
    yield started
    if started.runner.poll() is None:
        started.kill(both=True)


def test_killed_with_its_scribe_a_run_is_recovered_up_to_the_last_second(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run.wait_for(4.0)
    killed = run.kill(both=True)
    assert [p.name for p in tmp_path.iterdir()] == [JOURNAL]
    with run.journal.open("ab") as journal:
        journal.write(b"half")  # of a row
    assert main(["--policy", "go2", "--out", str(tmp_path)]) == 2
    assert "wt-run --recover" in capsys.readouterr().err and run.journal.is_file()
    assert main(["--recover", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert f"recovered {RECORDING}, {LOG}" in said and "wt diagnose" in said
    assert sorted(p.name for p in tmp_path.iterdir()) == [LOG, RECORDING]
    log, kept = pq.read_table(tmp_path / LOG), read(tmp_path / RECORDING)
    # the scribe has what the machine let it read, within a second unless others fill it
    assert 0.0 < killed - log["t"].to_numpy()[-1] < 2.0
    assert kept.meta["killed"] is True and kept.t[-1] > 2.0
    np.testing.assert_allclose(kept.columns["qpos/hip"], np.sin(log["robot_time"].to_numpy()))
    assert main(["--recover", str(tmp_path)]) == 2
    assert "nothing to recover" in capsys.readouterr().err


def test_a_scribe_that_outlives_its_runner_needs_no_recovery(run: Run, tmp_path: Path) -> None:
    run.wait_for(4.0)
    run.kill(both=False)
    deadline = time.monotonic() + 30
    while run.journal.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert sorted(p.name for p in tmp_path.iterdir()) == [LOG, RECORDING]


def test_what_goes_on_is_not_recovered(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run.wait_for(0.1)
    assert main(["--recover", str(tmp_path)]) == 1
    assert "goes on" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == [JOURNAL]


def test_a_journal_that_ends_too_early_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / JOURNAL).write_bytes(b'{"columns": ')
    assert main(["--recover", str(tmp_path)]) == 2
    assert "ends before the first tick" in capsys.readouterr().err
