"""Suggested motions of linear stages and of machines that nothing drives."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.diagnose import synthetic
from wt.diagnose.evidence import Trace
from wt.diagnose.experiment.excite import suggest
from wt.diagnose.experiment.release import release
from wt.diagnose.result import Confusable, Diagnosis
from wt.errors import WorkError
from wt.physics.scene import Scene
from wt.types import Location

FAR = 0.246  # m: the stage moved from 0 to here, and there may be a wall beyond either
MOTOR = '<motor name="m" joint="s" gear="35"/>'
SERVO = '<position name="m" joint="s" kp="20000" kv="2000"/>'
STAGE = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="carriage">
  <joint name="s" type="slide" axis="1 0 0"{range}/><geom type="box" size=".1 .1 .05" mass="95"/>
</body></worldbody><actuator>{drive}</actuator></mujoco>"""
POLE = """<mujoco><worldbody><body name="pole"><joint name="h" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 {z}" size=".02" mass=".5"/></body></worldbody></mujoco>"""
AT = Location("joint", "s")


def machine(folder: Path, xml: str) -> Path:
    path = folder / "machine.xml"
    path.write_text(xml)
    return path


def seen(q: np.ndarray, rate: float = 200.0) -> Trace:
    """A recording of one joint."""
    v, t = np.gradient(q, 1.0 / rate)[:, None], np.arange(len(q)) / rate
    column, zero = q[:, None], np.zeros_like(v)
    return Trace("a.parquet", "fit", t, column, column, column, v, zero, zero, {})


def moved(joint: str, q: np.ndarray, *, rivals: bool) -> Diagnosis:
    """A diagnosis of a machine with one joint."""
    full = synthetic.diagnosis()
    found = dataclasses.replace(
        full.findings[0], at=Location("joint", joint),
        confusable_with=(Confusable("joint.friction_viscous", AT, "…"),),
    )  # fmt: skip
    return dataclasses.replace(
        full, joints=(joint,), units=("m",), findings=(found,) if rivals else (), locations=(),
        traces=(seen(q),),
    )  # fmt: skip


def there_and_back(seconds: float = 12.0) -> np.ndarray:
    """It stands at zero before and after."""
    t = np.linspace(0.0, 1.0, int(200 * seconds))
    return FAR * np.sin(np.pi * t) ** 2


@pytest.mark.parametrize("rivals", [False, True])
@pytest.mark.parametrize("drive", [MOTOR, SERVO])
def test_a_stage_stays_where_it_was_seen(tmp_path: Path, drive: str, rivals: bool) -> None:
    path = machine(tmp_path, STAGE.format(range="", drive=drive))
    motion = suggest(moved("s", there_and_back(), rivals=rivals), path)
    q, slack = motion.columns["qpos/s"], 0.005 * FAR
    assert q.min() > -slack and q.max() < FAR + slack
    assert np.ptp(q) > 0.1 * FAR
    assert q[0] == pytest.approx(0.0, abs=slack) and q[-1] == pytest.approx(0.0, abs=slack)


def test_a_range_of_the_model_says_how_far_it_may_go(tmp_path: Path) -> None:
    path = machine(tmp_path, STAGE.format(range=' limited="true" range="-.1 .5"', drive=SERVO))
    q = suggest(moved("s", there_and_back(), rivals=True), path).columns["qpos/s"]
    assert q.min() > -0.1 and q.max() < 0.5


def test_it_starts_where_the_machine_stands(tmp_path: Path) -> None:
    """At the end of the last recording, here in the middle of what was seen."""
    q = there_and_back()
    q = np.concatenate([q, np.linspace(0.0, 0.5 * FAR, 400), np.full(300, 0.5 * FAR)])
    path = machine(tmp_path, STAGE.format(range="", drive=SERVO))
    motion = suggest(moved("s", q, rivals=False), path)
    assert motion.columns["qpos/s"][0] == pytest.approx(0.5 * FAR, abs=1e-3)


def test_what_has_no_range_and_never_moved_is_not_moved(tmp_path: Path) -> None:
    path = machine(tmp_path, STAGE.format(range="", drive=SERVO))
    with pytest.raises(WorkError, match="give the joints a range"):
        suggest(moved("s", np.zeros(2000), rivals=False), path)


def test_a_machine_without_drives_is_released_in_words(tmp_path: Path) -> None:
    swing = 1.2 * np.cos(np.linspace(0.0, 20.0, 2000))
    path = machine(tmp_path, POLE.format(z="-.5"))
    said = release(Scene(path), [seen(swing)])
    assert "release" in said and "h from 21°, 41° and 62°" in said
    with pytest.raises(WorkError, match="no actuator to command; instead hold the machine still"):
        suggest(moved("h", swing, rivals=False), path)
