"""From the robot to the diagnosis: what ``wt-run`` leaves of the simulated Go2, an IMU alone.

Nothing is known of where the trunk was but what an IMU and the feet say. Each recording is a whole
run, with a robot that lies on the floor and stands up.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.deploy.lockstep import NOTHING, Hidden, Motion, late, loaded, record, sway, walk
from wt.data.recording import check_against, read
from wt.diagnose.pipeline import diagnose
from wt.diagnose.result import Diagnosis, Finding
from wt.physics.scene import Scene

WALK = walk(0.5, 0.0, 0.0)
MOTIONS = {
    "walks": WALK, "walks fast": walk(0.9, 0.1, 0.0), "walks back, turning": walk(-0.4, 0.0, -0.3),
    "walks in a circle": walk(0.3, 0.0, 0.5), "walks sideways": walk(0.0, 0.3, 0.0),
    "turns": walk(0.0, 0.0, 0.8), "stands": walk(0.0, 0.0, 0.0),
    "sways": sway(0), "sways again": sway(1), "sways a third time": sway(2),
}  # fmt: skip
PLACE = (0.05, -0.02, 0.1)
"""Of a load, in the frame of the trunk [m]."""


def diagnosed(motion: Motion, folder: Path, hidden: Hidden = NOTHING) -> Diagnosis:
    model, recording = record(motion, folder, hidden)
    return diagnose(model, [recording])


def the_finding(said: Diagnosis, effect: str, at: str) -> Finding:
    (found,) = said.findings
    assert (found.effect, found.at.name) == (effect, at)
    assert said.verdict in ("explained", "partly_explained")
    return found


@pytest.mark.long
def test_a_run_in_lockstep_is_what_wt_run_leaves_and_the_same_every_time(tmp_path: Path) -> None:
    first, second = (read(record(WALK, tmp_path / name)[1]) for name in ("a", "b"))
    check_against(first, Scene(tmp_path / "a" / "model.xml").model)
    assert first.rate_hz == pytest.approx(500.0)
    assert not [name for name in first.columns if name.split("/")[1] == "base"]
    for name, values in first.columns.items():
        np.testing.assert_array_equal(values, second.columns[name])
    assert np.ptp(first.columns["qpos/FL_thigh_joint"][-500:]) > 0.2, "it does not walk"


@pytest.mark.long
@pytest.mark.parametrize("motion", MOTIONS)
def test_nothing_is_said_where_nothing_is_hidden(motion: str, tmp_path: Path) -> None:
    said = diagnosed(MOTIONS[motion], tmp_path)
    assert (said.verdict, said.findings) == ("no_mismatch", ())
    assert not [note for note in said.notes if "missing" in note]


@pytest.mark.long
def test_a_load_on_the_trunk_is_found(tmp_path: Path) -> None:
    found = the_finding(diagnosed(WALK, tmp_path, loaded(2.0, PLACE)), "body.payload_fixed", "base")
    assert found.parameters["mass"].value == pytest.approx(2.0, rel=0.2)
    assert found.parameters["position"].value == pytest.approx(PLACE, abs=0.04)


@pytest.mark.long
def test_drives_that_are_late_are_found(tmp_path: Path) -> None:
    found = the_finding(diagnosed(WALK, tmp_path, late(0.015)), "actuator.delay", "all")
    # to half a step of the simulated robot, by which its motion is ahead of a force
    assert found.parameters["delay"].value == pytest.approx(0.015, abs=0.001)


@pytest.mark.long
def test_a_weak_calf_is_found(tmp_path: Path) -> None:
    weak = Hidden(strength={"FR_calf_joint": 0.8})
    found = the_finding(diagnosed(WALK, tmp_path, weak), "actuator.gain", "FR_calf_joint")
    assert found.parameters["factor"].value == pytest.approx(0.8, abs=0.03)
