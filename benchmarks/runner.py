"""The runner on a simulated Go2: two processes over the loopback interface, timed.

First a walk: the timing report of ``wt-run``, what is asked of it on two cores, and where the robot
got. Then faults, one run each: from the moment at which the fault begins to the tick in which the
robot's drives brake, by the robot's own account.

Usage: python benchmarks/runner.py [--realtime]
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from deploy.dds import DdsParticipant
from deploy.go2 import LOW_COMMAND
from deploy.idl import LowCmd_

DOMAIN = 77
WALK = ("0.5:stand", "3.5:policy", "4:walk=0.5", "9:walk=0", "9.5:damping")
GOALS = {"jitter": ("loop jitter", 2.0), "inference": ("inference", 1.0)}
AT = 1.5  # s after the first command, when the robot is getting up
MOST = 40.0  # ms

Process = subprocess.Popen[str]


def main(*options: str) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        walk(folder / "walk", options)
        print(f"\n{'fault':<20}{'braking after':>14}   goal {MOST:g} ms")
        for fault in ("drop", "delay", "nan", "flip"):
            sim = simulate(folder / fault, options, "0.5:stand", "--fault", f"{fault}@{AT}")
            run(folder / fault, options, "--seconds", "2").communicate()
            sim.communicate()
            log = robots_account(folder / fault)
            report(fault, log, float(log["wall"][np.argmax(log["t"] >= AT)]))
        for fault in ("second publisher", "killed runner"):
            sim = simulate(folder / fault, options, "0.5:stand")
            runner = run(folder / fault, options)
            onset = interrupt(runner, fault)
            sim.communicate()
            report(fault, robots_account(folder / fault), onset)
            runner.terminate()
            runner.communicate()


def walk(folder: Path, options: tuple[str, ...]) -> None:
    """Stand up, walk for five seconds at 0.5 m/s, lie down."""
    sim = simulate(folder, options, *WALK, seconds=13.0)
    print(run(folder, options, "--seconds", "10.5").communicate()[0].rsplit("\n", 2)[0])
    timing = json.loads((folder / "run" / "report.json").read_text())["timing"]
    for key, (what, most) in GOALS.items():
        print(f"{what}: p99 {timing[key]['p99']:.3f} ms, goal {most:g} ms")
    print(f"told to walk at 0.5 m/s for 5 s; {sim.communicate()[0].splitlines()[1]}")


def simulate(folder: Path, options: tuple[str, ...], *words: str, seconds: float = 4.0) -> Process:
    """Start the robot."""
    return start("sim_go2", *options, *words, "--seconds", f"{seconds}", "--out", f"{folder}/sim")


def run(folder: Path, options: tuple[str, ...], *words: str) -> Process:
    """Start the runner."""
    return start("run", "--policy", "go2", *options, *words, "--out", f"{folder}/run")


def start(module: str, *words: str) -> Process:
    """Start a program of the package."""
    command = [sys.executable, "-m", f"deploy.cli.{module}", "--domain", str(DOMAIN), *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True)


def interrupt(runner: Process, fault: str) -> float:
    """Do what a simulated robot cannot do by itself, while the robot gets up; when it was done."""
    assert runner.stderr is not None
    while runner.stderr.readline().strip() != "stand":
        pass
    writer = DdsParticipant("lo", DOMAIN).writer(LOW_COMMAND, LowCmd_)
    time.sleep(1.0)
    onset = time.monotonic()
    if fault == "killed runner":
        runner.kill()
    else:
        writer.write(LowCmd_().seal())
    return onset


def robots_account(folder: Path) -> dict[str, np.ndarray]:
    """The simulated robot's log."""
    table = pq.read_table(folder / "sim" / "log.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}


def report(fault: str, log: dict[str, np.ndarray], onset: float) -> None:
    """Print a row: from a time of the shared clock [s] to the tick in which the drives brake."""
    braking = (log["wall"] >= onset) & (log["stiffness"] == 0) & (log["damping"] > 0)
    latency = float(log["wall"][np.argmax(braking)] - onset) if braking.any() else np.inf
    print(f"{fault:<20}{1e3 * latency:>11.1f} ms", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
