"""Runner and simulated robot as two processes, over DDS on the loopback interface.

How soon a fault ends in damping is counted in ticks of the process that has to notice it, from the
moment at which the fault began by the clock that both share. On a machine with time to spare that
is the latency; on one that is busy it does not blame the runner for the time it was not let run.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.parquet as pq
import pytest

from deploy.dds import DdsParticipant
from deploy.go2 import LOW_COMMAND
from deploy.idl import LowCmd_
from deploy.sim_robot import ENCODER_STEP, JOINTS
from tests.deploy.conftest import LENIENT, QUICK
from tests.deploy.policies import write_policy
from wt.data.recording import check_against, read
from wt.worlds import go2_model

MOST_TICKS = 20
"""40 ms at 500 Hz."""

PASSIVE, STAND, POLICY, DAMPING = range(4)


class Pair:
    """Both processes and what they leave.

    Attributes:
        out: folder; ``run`` and ``sim`` in it are theirs.
    """

    def __init__(self, out: Path, domain: int) -> None:
        self.out, self._domain = out, domain
        self.started: list[subprocess.Popen[str]] = []

    def start(self, module: str, *words: str) -> subprocess.Popen[str]:
        where = "run" if module == "run" else "sim"
        command = [sys.executable, "-m", f"deploy.cli.{module}", *words]
        command += ["--domain", str(self._domain), "--out", str(self.out / where)]
        pipe = subprocess.PIPE
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True
        )
        self.started.append(process)
        return process

    def sim_ends(self) -> str:
        """Tell the simulator to end; what it said."""
        sim = self.started[0]
        sim.send_signal(signal.SIGTERM)
        code, out, err = finished(sim)
        assert code == 0, err
        return out

    def ticks(self, where: str) -> dict[str, np.ndarray]:
        table = pq.read_table(self.out / where / "log.parquet")
        return {name: table[name].to_numpy() for name in table.column_names}

    def began(self) -> float:
        """When the runner's first tick was, by the clock that processes share [s]."""
        return float(json.loads((self.out / "run" / "report.json").read_text())["began"])


@pytest.fixture
def pair(tmp_path: Path, domain: int) -> Iterator[Pair]:
    made = Pair(tmp_path, domain)
    yield made
    for process in made.started:
        process.kill()
        process.wait()
        for stream in (process.stdout, process.stderr):
            assert stream is not None
            stream.close()


def finished(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def ticks_until_damping(pair: Pair, onset: float) -> int:
    """Ticks of the runner from a time of the shared clock to its first damping command."""
    log = pair.ticks("run")
    braking = (log["stiffness"] == 0) & (log["damping"] > 0)
    assert braking[-1], "the run did not end in damping"
    first = int(np.argmax(braking))
    assert braking[first:].all(), "the fault did not stay"
    return int((log["t"][: first + 1] + pair.began() >= onset).sum())


def test_a_go2_stands_up_walks_and_lies_down(pair: Pair) -> None:
    """From the operator's buttons to the recording, all that a real run has but the motors."""
    script = ("0.2:stand", "1.5:policy", "1.7:walk=0.5", "5.2:walk=0", "5.6:damping")
    pair.start("sim_go2", *script)
    run = pair.start("run", "--policy", "go2", *LENIENT, "--seconds", "6")
    code, out, err = finished(run)
    assert code == 0, err
    assert all(word in out for word in ("loop period", "loop jitter", "inference", "p99"))
    assert [line for line in err.splitlines() if line in ("stand", "policy", "damping")] == [
        "stand", "policy", "damping",
    ]  # fmt: skip
    pair.sim_ends()

    truth = pair.ticks("sim")
    walking = (truth["t"] > 2.2) & (truth["t"] < 5.2)
    x, height = truth["qpos/base/0"][walking], truth["qpos/base/2"][walking]
    physics = 0.002 * walking.sum()  # a busy machine leaves some of it out
    assert (x[-1] - x[0]) / physics == pytest.approx(0.5, rel=0.2)
    assert abs(np.ptp(truth["qpos/base/1"][walking])) < 0.3
    assert (height > 0.22).all()
    assert truth["stiffness"][-1] == 0 and truth["damping"][-1] > 0

    recording = read(pair.out / "run" / "recording.parquet")
    check_against(recording, go2_model.build(go2_model.PUBLISHED, 0.005))
    # 500 Hz are asked for; what a busy machine lets the loop do is in its report
    period = json.loads((pair.out / "run" / "report.json").read_text())["timing"]["period"]["p50"]
    assert period > 0.99 * 1e3 / 500
    assert recording.rate_hz == pytest.approx(1e3 / period, rel=0.02)
    assert recording.meta["policy"] == "go2" and recording.meta["robot"] == "go2"
    # what the runner heard is what was
    step = ENCODER_STEP[JOINTS.index("FL_calf_joint")]
    truth["qpos/FL_calf_joint"] = step * np.round(truth["qpos/FL_calf_joint"] / step)
    for name in ("qpos/FL_calf_joint", "qvel/RR_thigh_joint", "force/FR_hip_joint"):
        heard, true = recording.columns[name], truth[name]
        assert np.nanstd(heard) > 0 and set(np.float32(heard[200:400])) <= set(np.float32(true))


@pytest.mark.parametrize(
    ("fault", "name"),
    [("drop", "stale_state"), ("delay", "stale_state"), ("nan", "not_finite"), ("flip", "range")],
)
def test_bad_states_end_in_damping_within_40_ms(pair: Pair, fault: str, name: str) -> None:
    limits = (QUICK, "deadline=2") if name == "stale_state" else LENIENT
    pair.start("sim_go2", "0.1:stand", "--fault", f"{fault}@0.5")
    code, _, err = finished(pair.start("run", "--policy", "go2", *limits, "--seconds", "1"))
    assert code == 1 and err.splitlines()[-1].startswith(
        f"error: ended in damping after a fault: {name}"
    )
    pair.sim_ends()
    truth = pair.ticks("sim")
    onset = truth["wall"][np.argmax(truth["t"] >= 0.5)]
    assert ticks_until_damping(pair, onset) <= MOST_TICKS


def test_an_action_that_is_no_number_ends_in_damping_within_40_ms(
    pair: Pair, tmp_path: Path
) -> None:
    """A policy whose output is the square root of minus the command: fine, until it is to walk."""
    write_policy(tmp_path / "policy")
    pair.start("sim_go2", "0.1:stand", "1.3:policy", "1.7:walk=0.5")
    run = pair.start("run", "--policy", str(tmp_path / "policy"), *LENIENT, "--seconds", "2.1")
    code, _, err = finished(run)
    assert code == 1 and "action: the policy's output number 0 is no number" in err
    pair.sim_ends()
    log = pair.ticks("run")
    assert (log["stage"] == POLICY).any()
    asked = log["t"][np.argmax(log["command/forward"] > 0)] + pair.began()
    assert ticks_until_damping(pair, asked) <= MOST_TICKS
    heard = pair.ticks("sim")
    assert np.isfinite(heard["ctrl/FL_hip_joint"][heard["stiffness"] > 0]).all()


def test_a_second_publisher_ends_in_damping_within_40_ms(pair: Pair, domain: int) -> None:
    line = DdsParticipant("lo", domain)
    writer = line.writer(LOW_COMMAND, LowCmd_)
    pair.start("sim_go2", "0.1:stand")
    run = pair.start("run", "--policy", "go2", *LENIENT, "--seconds", "1.2")
    assert run.stderr is not None
    while run.stderr.readline().strip() != "stand":
        assert run.poll() is None
    time.sleep(0.5)
    onset = time.monotonic()
    for _ in range(5):
        writer.write(LowCmd_().seal())
        time.sleep(0.01)
    code, _, err = finished(run)
    assert code == 1 and "intruder: another program commands the robot" in err
    assert ticks_until_damping(pair, onset) <= MOST_TICKS


def standing(pair: Pair) -> subprocess.Popen[str]:
    """A runner whose robot has begun to stand up."""
    pair.start("sim_go2", "0.1:stand")
    run = pair.start("run", "--policy", "go2", *LENIENT)
    assert run.stderr is not None
    while run.stderr.readline().strip() != "stand":
        assert run.poll() is None
    return run


def test_a_killed_runner_leaves_a_robot_that_brakes_within_40_ms(pair: Pair) -> None:
    """Nobody can send anything any more: the robot's own watchdog is counted, in its ticks."""
    run = standing(pair)
    time.sleep(0.5)
    run.kill()
    time.sleep(0.5)
    pair.sim_ends()
    truth = pair.ticks("sim")
    last = np.flatnonzero(truth["heard"])[-1]
    assert truth["stiffness"][last] > 0
    braking = (truth["stiffness"] == 0) & (truth["damping"] > 0)
    assert int(np.argmax(braking[last:])) <= MOST_TICKS and braking[last + MOST_TICKS :].all()


def test_a_killed_runner_leaves_its_recording_and_the_model_to_diagnose_it_with(
    pair: Pair,
) -> None:
    run = standing(pair)
    time.sleep(4.0)
    run.kill()
    recording = pair.out / "run" / "recording.parquet"
    deadline = time.monotonic() + 30
    while not recording.is_file() and time.monotonic() < deadline:
        time.sleep(0.1)
    kept = read(recording)
    assert kept.meta["killed"] is True and kept.t[-1] > 3.0
    check_against(kept, mujoco.MjModel.from_xml_path(str(pair.out / "run" / "model.xml")))


def test_ctrl_c_ends_in_damping_and_writes_what_there_is(pair: Pair) -> None:
    run = standing(pair)
    time.sleep(0.5)
    run.send_signal(signal.SIGINT)
    code, out, _ = finished(run)
    assert code == 0 and "log.parquet, model.xml, report.json" in out
    log = pair.ticks("run")
    braking = (log["stiffness"] == 0) & (log["damping"] > 0)
    first = int(np.argmax(braking))
    assert braking[first:].all() and log["t"][-1] - log["t"][first] > 0.9


def test_a_dry_run_sends_nothing(pair: Pair) -> None:
    pair.start("sim_go2")
    run = pair.start("run", "--policy", "go2", *LENIENT, "--dry-run", "--seconds", "0.5")
    code, _, err = finished(run)
    assert code == 0, err
    assert "nobody commanded it" in pair.sim_ends()
    assert len(pair.ticks("run")["t"]) > 100
