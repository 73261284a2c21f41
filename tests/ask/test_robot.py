"""What carries experiments out."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from tests.ask.conftest import RATE, XML
from wt.ask.loop import Experiments
from wt.ask.robot import FileRobot, SimulatedRobot
from wt.data import recording as recordings
from wt.errors import ModelError, WorkError
from wt.types import Recording


def commands(name: str = "a") -> Recording:
    t = np.arange(300) / RATE
    return Recording(t, {f"ctrl/{name}": 0.3 * np.sin(t), "qpos/j": np.zeros(300)})


def test_a_simulated_machine_stands_first_and_then_follows(tmp_path: Path) -> None:
    world = tmp_path / "world.xml"
    world.write_text(XML.replace('mass=".8"', 'mass="1.6"'))
    measured = SimulatedRobot(world, 0.0, 0).perform(1, commands())
    q = measured.columns["qpos/j"]
    assert abs(np.diff(q)[:3]).max() < 1e-3, "it hangs in balance before it moves"
    assert q[0] == pytest.approx(1.6 * 9.81 * 0.15 / 40.0, rel=0.05)
    assert np.ptp(q) == pytest.approx(0.3, rel=0.1)
    np.testing.assert_array_equal(measured.columns["ctrl/a"], commands().columns["ctrl/a"])
    noisy = SimulatedRobot(world, 1e-3, 0).perform(1, commands()).columns["qpos/j"]
    assert np.std(noisy - q) == pytest.approx(1e-3, rel=0.2)


def test_another_machine_is_refused(tmp_path: Path) -> None:
    world = tmp_path / "world.xml"
    world.write_text("<mujoco")
    with pytest.raises(ModelError, match="does not load"):
        SimulatedRobot(world, 0.0, 0)
    world.write_text(XML)
    with pytest.raises(ModelError, match="another machine"):
        SimulatedRobot(world, 0.0, 0).perform(1, commands("b"))


def test_a_person_is_told_and_waited_for(tmp_path: Path) -> None:
    said: list[str] = []
    robot = FileRobot(tmp_path, 20.0, said.append)
    kept: list[str] = []
    experiments = Experiments(robot, lambda name, _: kept.append(name))

    def person() -> None:
        while not said:
            time.sleep(0.01)
        recordings.write(commands(), tmp_path / "recorded_1.parquet")

    thread = threading.Thread(target=person)
    thread.start()
    experiments.run(commands())
    thread.join()
    assert "experiment_1.parquet" in said[0] and "recorded_1.parquet" in said[0]
    assert kept == ["experiment_1"], "what the person put there is theirs"
    # the same command again goes on from it
    assert len(Experiments(robot, lambda *_: None).recorded) == 1


def test_nobody_comes(tmp_path: Path) -> None:
    with pytest.raises(WorkError, match="run the same command again"):
        FileRobot(tmp_path, 0.0, lambda _: None).perform(1, commands())
