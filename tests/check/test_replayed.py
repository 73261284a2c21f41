"""A model that explodes under the recording's commands, or whose time step is too coarse."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.check.machines import MACHINES, record
from wt.check.finding import AuditFinding
from wt.check.run import check
from wt.physics.scene import Scene
from wt.types import Recording


def found(xml: str, recording: Recording, folder: Path) -> list[AuditFinding]:
    path = folder / "m.xml"
    path.write_text(xml)
    return [f for f in check(Scene(path), recording).findings if f.sure]


def stepped(name: str, step: float) -> str:
    return MACHINES[name].xml.replace('timestep="0.001"', f'timestep="{step:g}"')


@pytest.mark.parametrize(("name", "step"), [("arm4", 0.01), ("planar", 0.01), ("arm4", 0.008)])
def test_a_step_too_coarse_for_the_recording(name: str, step: float, tmp_path: Path) -> None:
    recording = record(name, 60, robot=stepped(name, 0.0005))
    (fault,) = found(stepped(name, step), recording, tmp_path)
    assert fault.kind == "model_timestep"
    assert fault.model_change is not None
    spec = mujoco.MjSpec.from_string(stepped(name, step))
    fault.model_change(spec)
    assert spec.option.timestep == pytest.approx(step / 8)


@pytest.mark.parametrize("missing", ['frictionloss="0.6" ', 'armature="0.1" ', ""])
def test_what_was_recorded_of_the_same_steps_is_right(missing: str, tmp_path: Path) -> None:
    model = stepped("planar", 0.005)
    recording = record("planar", 61, robot=model.replace("damping=", f"{missing}damping="))
    assert not found(model, recording, tmp_path)


@pytest.mark.parametrize("step", [0.001, 0.002])
def test_a_step_that_does_is_none(step: float, tmp_path: Path) -> None:
    assert not found(stepped("arm4", step), record("arm4", 62), tmp_path)


SLIDE = """<mujoco><option timestep="{}" integrator="Euler"><flag eulerdamp="disable"/></option>
<worldbody><body><joint name="a" type="slide" axis="1 0 0"/><geom size=".1" mass=".05"/></body>
</worldbody><actuator><position name="a_m" joint="a" kp="20" kv="2"/></actuator></mujoco>"""


def test_a_model_that_explodes_under_the_commands_alone(tmp_path: Path) -> None:
    """At rest, at zero, it stays there."""
    m, t = mujoco.MjModel.from_xml_string(SLIDE.format(0.0005)), np.arange(600) / 100.0
    d, q, u = mujoco.MjData(m), np.empty(600), 0.3 * np.sin(2.0 * t) + 0.1 * np.sin(5.0 * t)
    for k in range(600):
        q[k], d.ctrl[:] = d.qpos[0], u[k]
        mujoco.mj_step(m, d, 20)
    recording = Recording(t, {"qpos/a": q, "ctrl/a_m": u})
    (fault,) = found(SLIDE.format(0.08), recording, tmp_path)
    assert fault.kind == "model_explodes"
    assert "recording's commands" in fault.evidence
