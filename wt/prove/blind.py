"""Diagnoses in the dark: each in a process that gets a model and recordings, and nothing else.

A process starts in an empty folder of its own, with copies of the case's MJCF and recordings, a
clean environment, no input and a guard in front of it (:mod:`wt.prove.guard`). What it leaves in
``out/`` becomes the case's diagnosis; its folder is deleted.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from wt.prove.asked import AskedMachine
from wt.show.files import write_whole

GUARD = Path(__file__).with_name("guard.py")
ROOT = GUARD.parents[2]
"""The folder that the package ``wt`` is in."""
GENERATOR = GUARD.parent
RAN = "ran.json"
_POLL_S = 0.05


@dataclass(frozen=True)
class DiagnosisJob:
    """One diagnosis that is to be made.

    Attributes:
        case: folder with ``robot.xml``, ``fit-*.parquet`` and ``holdout-*.parquet``.
        out: folder that the diagnosis becomes; it does not exist yet.
        program: from the names of fitted and held-out recordings to the module that is run and
            its arguments; it writes into ``out``.
        closed: paths that the process may not see, besides all that are not its own.
        limit_s: time after which it is ended [s].
        product: a file that it writes, or a pattern, in its folder; what lies beside that becomes
            the diagnosis.
        machine: the machine, if it may be asked in ``out``.
    """

    case: Path
    out: Path
    program: Callable[[Sequence[str], Sequence[str]], Sequence[str]]
    closed: tuple[Path, ...]
    limit_s: float
    product: str = "out/diagnosis.json"
    machine: AskedMachine | None = None


@dataclass(frozen=True)
class Ran:
    """Outcome of a diagnosis.

    Attributes:
        seconds: wall-clock time [s].
        error: one line; "" if it came back with a diagnosis.
    """

    seconds: float
    error: str


def run(jobs: Sequence[DiagnosisJob], processes: int) -> Iterator[tuple[DiagnosisJob, Ran]]:
    """Make diagnoses side by side; each job with its outcome as it ends.

    However this generator ends, no process of it is left.
    """
    left, running = list(jobs), list[_Process]()
    try:
        while left or running:
            while left and len(running) < processes:
                with _interrupt_waits():
                    running.append(_Process(left.pop(0)))
            ended = [process for process in running if process.ended()]
            for process in ended:
                with _interrupt_waits():
                    running.remove(process)
                    ran = process.collect()
                yield process.job, ran
            if not ended:
                time.sleep(_POLL_S)
    finally:
        for process in running:
            process.kill()


@contextlib.contextmanager
def _interrupt_waits() -> Iterator[None]:
    """Ctrl-C within takes effect at the end, so that no process starts that nobody would end."""
    if threading.current_thread() is not threading.main_thread():
        yield  # interrupts come to the main thread only
        return
    came: list[FrameType | None] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(frame))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came and callable(before):
        before(signal.SIGINT, came[0])


def inputs(case: Path) -> tuple[list[Path], list[Path]]:
    """Fitted and held-out recordings of a case's folder, in the order of their names."""
    return sorted(case.glob("fit*.parquet")), sorted(case.glob("holdout*.parquet"))


class _Process:
    """A running diagnosis."""

    def __init__(self, job: DiagnosisJob) -> None:
        self.job, self._began = job, time.monotonic()
        self._home = Path(tempfile.mkdtemp(prefix="blind-")).resolve()
        fit, holdout = inputs(job.case)
        for file in (job.case / "robot.xml", *fit, *holdout):
            shutil.copyfile(file, self._home / file.name)
        program = job.program([f.name for f in fit], [f.name for f in holdout])
        walls = {
            "root": str(ROOT),
            "folder": str(self._home),
            "closed": [str(path.resolve()) for path in job.closed],
        }
        command = [sys.executable, "-I", "-X", "utf8", str(GUARD), json.dumps(walls), *program]
        with (self._home / "said").open("wb") as said:
            self._process = subprocess.Popen(
                command, cwd=self._home, env=environment(self._home), stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=said, start_new_session=True,
            )  # fmt: skip
        self._late = False

    def ended(self) -> bool:
        """True once it has ended; beyond its time limit it is ended here."""
        if self.job.machine is not None:
            self.job.machine.attend(self._home / "out")
        if self._process.poll() is not None:
            return True
        if time.monotonic() - self._began > self.job.limit_s:
            self._late = True
            self._end()
        return self._late

    def collect(self) -> Ran:
        """Move its files to their place, and clean up."""
        seconds = time.monotonic() - self._began
        product = next(self._home.glob(self.job.product), None)
        error = ""
        if self._late:
            error = f"ended after {self.job.limit_s:.0f} s"
        elif self._process.returncode or product is None:
            lines = (self._home / "said").read_text(errors="replace").strip().splitlines()
            error = lines[-1] if lines else f"ended with exit code {self._process.returncode}"
        ran = Ran(seconds, error)
        part = self.job.out.with_name(f".{self.job.out.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        if product is not None and not error:
            for file in product.parent.iterdir():
                if file.is_file():
                    shutil.copyfile(file, part / file.name)
        asked = self.job.machine.said() if self.job.machine is not None else {}
        outcome = {"seconds": round(seconds, 2), "error": error, **asked}
        write_whole(part / RAN, json.dumps(outcome) + "\n")
        part.rename(self.job.out)
        shutil.rmtree(self._home, ignore_errors=True)
        return ran

    def kill(self) -> None:
        """End it, and leave nothing behind."""
        self._end()
        shutil.rmtree(self._home, ignore_errors=True)

    def _end(self) -> None:
        # it leads a group of its own, which has what it may have started
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


def environment(home: Path) -> dict[str, str]:
    """Environment variables of a diagnosing process, all of them."""
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    return threads | {
        "PATH": os.defpath,
        "HOME": str(home),
        "TMPDIR": str(home),
        "LANG": "C.UTF-8",
        "MUJOCO_GL": "disable",  # looking for a display starts processes
    }
