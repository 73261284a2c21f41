"""The process that tells when the robot is no longer the one in its passport."""

from __future__ import annotations

import io
import json
import os
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deploy import drift
from deploy.record import Recorder
from deploy.robot import Command
from tests.passport.test_add import RIG
from tests.passport.test_add import record as recorded
from wt.data import recording as recordings
from wt.diagnose import again
from wt.errors import UserError
from wt.passport.add import add
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location, Recording

DRIVEN = RIG.replace('name="servo"', 'name="hinge"')
USUAL = 0.2  # N·m


def motion(folder: Path, friction: float, seed: int, seconds: int = 8) -> Recording:
    """Some seconds; the drive is called as its joint, as a robot's are."""
    read = recordings.read(recorded(folder / f"{seed}.parquet", friction, seed, {}, seconds))
    columns = {name.replace("servo", "hinge"): column for name, column in read.columns.items()}
    return replace(read, columns=columns)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, and a passport that was made of recordings of it."""
    home = tmp_path_factory.mktemp("robot")
    (home / "model.xml").write_text(DRIVEN.format(friction=""))
    labels = {"unit": "A17", "session": "2026-11-01"}
    for seed in range(3):
        of_unit = replace(motion(home, USUAL, seed), meta=labels)
        recordings.write(of_unit, home / f"{seed}-a17.parquet")
    dry = Planted(
        effects()["joint.friction_coulomb"], Location("joint", "hinge"), np.array([USUAL])
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(again, "named", lambda *_: (dry,))
        add(home / "model.xml", sorted(home.glob("*-a17.parquet")), home / "passport")
    return home


def new_recorder() -> Recorder:
    return Recorder(["qpos/hinge", "qvel/hinge"], ["hinge"], [])


def run(recorder: Recorder, folder: Path, friction: float) -> None:
    """Note twelve seconds in which positions were held."""
    read = motion(folder, friction, 50, 12)
    u, q, v = (read.columns[f"{kind}/hinge"] for kind in ("ctrl", "qpos", "qvel"))
    for k, t in enumerate(read.t):
        command = Command(u[k : k + 1], np.ones(1), np.ones(1))
        recorder.row(float(t), float(t), np.array([q[k], v[k]]), command, ())


def told(robot: Path, out: Path, friction: float) -> list[dict[str, object]]:
    """What is judged of a run, by the process's own function at the end of a pipe."""
    recorder = new_recorder()
    rows: list[bytes] = []
    recorder.follow(lambda row: rows.append(row.tobytes()))
    run(recorder, out, friction)
    reading, writing = os.pipe()

    def send() -> None:
        with os.fdopen(writing, "wb") as pipe:
            header = {"columns": recorder.columns, "meta": {}}
            pipe.write(json.dumps(header).encode() + b"\n")
            pipe.flush()
            for row in rows:
                pipe.write(row)

    threading.Thread(target=send).start()
    with os.fdopen(reading, "rb", buffering=0) as stream:
        drift.main(
            io.BufferedReader(stream, 1), out, robot / "passport", "A17", robot / "model.xml"
        )
    judged: list[dict[str, object]] = json.loads((out / drift.DRIFT).read_text())["judgements"]
    return judged


def test_the_same_robot_is_not_accused(
    robot: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (judgement,) = told(robot, tmp_path, USUAL)
    assert judgement["changed"] == [] and judgement["why_not"] == ""
    assert capfd.readouterr().err == ""


def test_the_operator_is_told_which_joint_changed(
    robot: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (judgement,) = told(robot, tmp_path, 2.0 * USUAL)
    assert judgement["changed"] == ["hinge"]
    assert "A17 is no longer the machine in its passport: joint hinge" in capfd.readouterr().err


def test_it_is_a_process_that_follows_the_runner(robot: Path, tmp_path: Path) -> None:
    recorder = new_recorder()
    watching = drift.watch(tmp_path, robot / "passport", "", robot / "model.xml", recorder)
    # all that takes long at first is over before the run begins
    assert os.sched_getscheduler(watching.pid) == os.SCHED_IDLE
    run(recorder, tmp_path, USUAL)
    try:
        until = time.monotonic() + 60.0
        while not (tmp_path / drift.DRIFT).exists() and time.monotonic() < until:
            time.sleep(0.1)
        assert (tmp_path / drift.DRIFT).exists()
    finally:
        watching.dismiss()
    assert json.loads((tmp_path / drift.DRIFT).read_text())["unit"] == "A17"


def test_no_tick_wakes_the_process(robot: Path, tmp_path: Path) -> None:
    recorder = new_recorder()
    watching = drift.watch(tmp_path, robot / "passport", "", robot / "model.xml", recorder)

    def woken() -> int:
        """How often its threads have waited and gone on."""
        return sum(
            int(line.split()[1])
            for thread in Path(f"/proc/{watching.pid}/task").iterdir()
            for line in (thread / "status").read_text().splitlines()
            if line.startswith("voluntary_ctxt_switches")
        )

    try:
        recorder.row(0.0, 0.0, np.zeros(2), Command(np.zeros(1), np.ones(1), np.ones(1)), ())
        time.sleep(1.0)
        before = woken()
        for k in range(400):
            t = 0.002 * (k + 1)
            recorder.row(t, t, np.zeros(2), Command(np.zeros(1), np.ones(1), np.ones(1)), ())
            time.sleep(0.002)
        assert woken() - before < 40
    finally:
        watching.dismiss()


def test_what_cannot_be_watched_is_said_before_the_run(robot: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(DRIVEN.format(friction=' frictionloss=".1"'))
    cases = (
        (tmp_path / "none", "", robot / "model.xml", "holds no passport"),
        (robot / "passport", "", other, "is of another model"),
        (robot / "passport", "A71", robot / "model.xml", "did you mean 'A17'"),
    )
    for passport, unit, model, said in cases:
        with pytest.raises(UserError, match=said):
            drift.watch(tmp_path, passport, unit, model, new_recorder())
