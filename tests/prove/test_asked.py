"""A hidden machine that is asked through files, and who asks it."""

from __future__ import annotations

import json
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wt.cli.main import main
from wt.data import recording as recordings
from wt.prove import asked, contenders
from wt.prove.asked import AskedMachine, perform
from wt.prove.case import Case, HiddenEffect
from wt.prove.cases import cases
from wt.prove.results import RESULTS
from wt.prove.sensing import Sensing
from wt.types import Recording

BAND = HiddenEffect("actuator.deadband", "actuator", "hinge_drive", {"width": 1.5},
                    "actuator.deadband")  # fmt: skip
SHARP = Sensing(rate=100.0, bits=20, noise=1e-6, qvel="none")
COUNT = 220  # rows
SWALLOWING = Case("000-band", "pendulum", 3, "single", (BAND,), SHARP, asked.MOTIONS, 4.0)


class AtOnce(Executor):
    """Does what it is told in this process."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def ask(folder: Path, number: int, furthest: float = 1.0) -> Recording:
    """Write commands: to and fro, from .4 rad."""
    t = np.arange(COUNT) / 100.0
    u = 0.4 + (furthest - 0.4) * np.sin(np.pi * t / t[-1])
    commands = Recording(t, {"ctrl/hinge_drive": u, "qpos/hinge": np.full(COUNT, 0.4)})
    recordings.write(commands, folder / f"experiment_{number}.parquet")
    return commands


def test_the_machine_does_what_it_is_told_with_what_is_hidden_in_it(tmp_path: Path) -> None:
    commands = ask(tmp_path, 1)
    reach = perform(SWALLOWING, 1, tmp_path / "experiment_1.parquet", tmp_path / "with.parquet")
    healthy = replace(SWALLOWING, truth=())
    perform(healthy, 1, tmp_path / "experiment_1.parquet", tmp_path / "without.parquet")
    measured, without = (recordings.read(tmp_path / f"{n}.parquet") for n in ("with", "without"))
    np.testing.assert_allclose(measured.t, commands.t, atol=1e-9)
    np.testing.assert_array_equal(
        measured.columns["ctrl/hinge_drive"], commands.columns["ctrl/hinge_drive"]
    )
    q, calm = measured.columns["qpos/hinge"], without.columns["qpos/hinge"]
    # a servo that swallows 1.5 of 30 N·m/rad is up to .05 rad further from where it is to be
    assert 0.03 < np.abs(q - calm).max() < 0.08
    assert reach == pytest.approx(np.abs(q).max() / 2.6, abs=1e-3)


def test_each_experiment_is_carried_out_once(tmp_path: Path) -> None:
    machine = AskedMachine(SWALLOWING, AtOnce())
    machine.attend(tmp_path)
    assert machine.said() == {"experiments": 0, "reach": 0.0}
    ask(tmp_path, 1)
    machine.attend(tmp_path)
    first = (tmp_path / "recorded_1.parquet").read_bytes()
    machine.attend(tmp_path)
    assert not (tmp_path / "recorded_2.parquet").exists()
    ask(tmp_path, 2, furthest=3.2)
    machine.attend(tmp_path)
    assert (tmp_path / "recorded_1.parquet").read_bytes() == first
    assert (tmp_path / "recorded_2.parquet").exists()
    said = machine.said()
    assert said["experiments"] == 2
    assert float(str(said["reach"])) > 1.0, "it left its range of 2.6 rad"


def test_cases_that_are_asked_have_one_slow_recording() -> None:
    drawn = cases("ask", 7)
    assert len(drawn) > 30
    assert {case.motions for case in drawn} == {asked.MOTIONS}
    assert {case.kind for case in drawn} == {"single"}
    assert {case.rig for case in drawn} == {"pendulum", "arm3"}


def test_the_control_gets_as_many_multisines_as_were_asked_for() -> None:
    fit = [f"fit-{k}.parquet" for k in range(1, 5)]
    control = contenders.program("multisines", 60.0, 2)(fit, ["holdout-1.parquet"])
    assert control[2:7] == ["robot.xml", fit[1], fit[2], "--holdout", fit[0]]
    once = ["wt.cli.main", "diagnose", "robot.xml", fit[0], "--out", "out", "--jobs", "1"]
    assert contenders.program("multisines", 60.0, 0)(fit, []) == once
    assert contenders.program("once", 60.0, 2)(fit, []) == once
    assert contenders.program("ask", 60.0)(fit, [])[:4] == [
        "wt.cli.main", "ask", "robot.xml", fit[0],
    ]  # fmt: skip


def test_rivals_do_not_ask(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", "--set", "ask", "--rivals"]) == 2
    assert "rivals do not ask" in capsys.readouterr().err


@pytest.mark.long
def test_a_dead_band_that_one_recording_leaves_open_is_named(tmp_path: Path) -> None:
    words = ["--set", "ask", "--only", "pendulum-actuator.deadband-obvious", "--seed", "5"]
    assert main(["prove", *words, "--jobs", "2", "--out", str(tmp_path / "trial")]) == 0
    found = json.loads((tmp_path / "trial" / RESULTS).read_text())["scores"]
    assert found["ask"]["effect"]["right"] == 1
    assert found["once"]["effect"]["right"] == 0
    assert found["ask"]["beyond_range"]["right"] == 0
