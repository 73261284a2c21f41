"""Commands from a file as what moves the robot."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from deploy.playback import Playback, joint_targets, servo_gains
from deploy.robot import Command
from deploy.runner import Runner
from deploy.stages import Stage
from tests.deploy.conftest import LENIENT
from tests.deploy.lockstep import LIMITS, LockstepOperator, LockstepRobot
from wt.ask.robot import Go2Robot
from wt.data import recording as recordings
from wt.errors import ModelError, RecordingError, WorkError
from wt.types import Recording
from wt.worlds.go2_model import DEFAULT, JOINTS
from wt.worlds.robots import mjcf

RATE, SECONDS = 100.0, 2.5


def wave() -> Recording:
    """Every joint swings around the default pose, and ends there."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    swing = 0.1 * np.sin(2.0 * np.pi * t / SECONDS)
    return Recording(t, {f"ctrl/{name}": DEFAULT[k] + swing for k, name in enumerate(JOINTS)})


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "hung.xml"
    path.write_text(mjcf("go2", hung=True))
    return path


def test_the_robot_goes_to_where_they_begin_plays_them_once_and_ends(model: Path) -> None:
    robot = LockstepRobot(hung=True)
    source = Playback(*joint_targets(wave(), JOINTS), servo_gains(model, JOINTS))
    runner = Runner(robot, source, LockstepOperator(robot), LIMITS, robot, lambda line: None)
    outcome = runner.run(seconds=60.0, brake=0.1)
    assert outcome.fault is None
    assert runner.events[-1][0] < 10.0, "it ends by itself"
    ticks = runner.recorder.ticks()
    playing = ticks["stage"] == list(Stage).index(Stage.POLICY)
    t, sent = ticks["t"][playing], ticks[f"ctrl/{JOINTS[0]}"][playing]
    assert np.ptp(t) == pytest.approx(SECONDS, abs=0.05)
    wanted = DEFAULT[0] + 0.1 * np.sin(2.0 * np.pi * (t - t[0]) / SECONDS)
    np.testing.assert_allclose(sent, wanted, atol=0.1 * 2 * np.pi / SECONDS / RATE + 1e-3)
    rising = ticks["stage"] == list(Stage).index(Stage.STAND)
    assert abs(ticks[f"qpos/{JOINTS[2]}"][rising][-1] - DEFAULT[2]) < 0.1
    recording = runner.recorder.recording()
    assert recording.t[-1] > SECONDS


def test_commands_that_cannot_be_played_are_refused(model: Path, tmp_path: Path) -> None:
    whole = wave()
    columns = {k: v for k, v in whole.columns.items() if not k.endswith("RR_calf_joint")}
    with pytest.raises(RecordingError, match="ctrl/RR_calf_joint"):
        joint_targets(Recording(whole.t, columns), JOINTS)
    t = whole.t.copy()
    t[50:] += 0.5
    with pytest.raises(RecordingError, match="evenly spaced"):
        joint_targets(Recording(t, whole.columns), JOINTS)
    holes = {k: np.where(whole.t > 1.0, np.nan, v) for k, v in whole.columns.items()}
    with pytest.raises(RecordingError, match="numbers throughout"):
        joint_targets(Recording(whole.t, holes), JOINTS)


def test_gains_are_the_models_and_other_drives_are_refused(model: Path, tmp_path: Path) -> None:
    stiffness, damping = servo_gains(model, JOINTS)
    assert stiffness.tolist() == [50.0] * 12
    assert damping.tolist() == [3.5] * 12
    other = tmp_path / "other.xml"
    other.write_text("<mujoco")
    with pytest.raises(ModelError, match="does not load"):
        servo_gains(other, JOINTS)
    other.write_text("<mujoco/>")
    with pytest.raises(ModelError, match="no actuator FL_hip_joint"):
        servo_gains(other, JOINTS)
    other.write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<actuator><motor name="j" joint="j"/></actuator></mujoco>'
    )
    with pytest.raises(ModelError, match="position servo"):
        servo_gains(other, ("j",))


def test_a_hung_robot_does_not_fall() -> None:
    robot = LockstepRobot(hung=True)
    robot.sleep_until(1.0)
    robot.send(Command(DEFAULT, np.full(12, 50.0), np.full(12, 3.5)))
    robot.sleep_until(2.0)
    state = robot.read()
    assert state is not None
    np.testing.assert_allclose(state.quaternion, [1, 0, 0, 0], atol=1e-9)
    assert robot.truth()[2] == pytest.approx(1.0)


def test_a_go2_on_the_network_is_asked(model: Path, tmp_path: Path, domain: int) -> None:
    """``wt ask --robot go2``: wt-run plays an experiment on the simulated robot."""
    recordings.write(wave(), tmp_path / "experiment_1.parquet")
    words = ["0.3:stand", *(f"{t}:policy" for t in range(2, 60)), "--hung", "--domain", str(domain)]
    sim = subprocess.Popen([sys.executable, "-m", "deploy.cli.sim_go2", *words])
    try:
        robot = Go2Robot(tmp_path, model, "lo", domain, LENIENT)
        measured = robot.perform(1, wave())
    finally:
        sim.terminate()
        sim.wait()
    assert measured.t[-1] > SECONDS
    sent, q = (measured.columns[f"{kind}/{JOINTS[1]}"] for kind in ("ctrl", "qpos"))
    last = measured.t > measured.t[-1] - SECONDS  # a busy machine needs longer for all of it
    assert np.max(DEFAULT[1] - sent[last]) == pytest.approx(0.1, abs=0.02)
    assert np.abs(q - sent)[last].max() < 0.15
    assert (tmp_path / "run_1" / "model.xml").read_text() == model.read_text()
    with pytest.raises(WorkError, match="begins this experiment again"):
        Go2Robot(tmp_path, tmp_path / "none.xml", "lo", domain).perform(1, wave())
