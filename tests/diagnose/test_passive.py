"""A machine without drives: it is released, and its motion alone says what is missing."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.pipeline import diagnose
from wt.diagnose.recordings.prepare import prepare
from wt.errors import RecordingError
from wt.physics.scene import Scene
from wt.types import Recording

ROD = (
    '<mujoco><option timestep="0.0005"/><worldbody><body name="rod"><joint name="h" axis="0 1 0" '
    'damping="0.002"{}/><geom name="g" type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass=".5" '
    'contype="0" conaffinity="0"/></body></worldbody></mujoco>'
)
DRIVEN = ROD.format("").replace(
    "</worldbody>", '</worldbody><actuator><motor name="m" joint="h"/></actuator>'
)


def swing(xml: str, seconds: float = 8.0, start: float = 1.4) -> Recording:
    """Positions of a rod that was let go, with an encoder's noise."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, angle = mujoco.MjData(model), []
    data.qpos[0] = start
    for _ in range(round(100 * seconds)):
        angle.append(float(data.qpos[0]))
        mujoco.mj_step(model, data, 20)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(angle))
    return Recording(np.arange(len(angle)) / 100.0, {"qpos/h": np.array(angle) + noise}, {})


def test_its_friction_is_found(tmp_path: Path) -> None:
    path = tmp_path / "rod.xml"
    path.write_text(ROD.format(""))
    found = diagnose(path, [swing(ROD.format(' frictionloss="0.02"'), seconds=5.0)])
    (finding,) = found.findings
    assert found.verdict == "explained" and finding.effect == "joint.friction_coulomb"
    assert finding.parameters["coulomb"].value == pytest.approx(0.02, rel=0.1)
    # nothing can be commanded: it is said how to let it go
    assert all("release" in c.separating_experiment for c in finding.confusable_with)


def test_commands_are_asked_for_where_the_model_has_actuators(tmp_path: Path) -> None:
    path = tmp_path / "driven.xml"
    path.write_text(DRIVEN)
    with pytest.raises(RecordingError, match=r"'ctrl/m' is missing.*a model without actuators"):
        prepare(Scene(path), [swing(ROD.format(""))], [])


def test_what_rests_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "rod.xml"
    path.write_text(ROD.format(""))
    still = Recording(np.arange(400) / 100.0, {"qpos/h": np.zeros(400)}, {})
    with pytest.raises(RecordingError, match=r"nothing moves.*released away from rest"):
        prepare(Scene(path), [still], [])
