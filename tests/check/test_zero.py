"""Zeros of encoders, beside springs that look like one and stops that do not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.check.machines import MACHINES, record, with_columns
from wt.check.run import check
from wt.physics.scene import Scene
from wt.types import Recording

ARM = """<mujoco><compiler angle="radian"/><option timestep=".001"/><worldbody>
<body><joint name="shoulder" axis="0 1 0" damping=".1" armature=".01"{spring}/>
<geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1"/></body></worldbody>
<actuator><motor name="drive" joint="shoulder"/></actuator></mujoco>"""
STIFFNESS, REST = 6.0, 0.3  # N·m/rad and rad; the weight is 2.5 N·m
RATE = 200


def recorded(xml: str) -> Recording:
    """A slow motion under a controller of torques, which compensates the weight only."""
    m = mujoco.MjModel.from_xml_string(xml)
    d, rng = mujoco.MjData(m), np.random.default_rng(0)
    t = np.arange(10 * RATE) / RATE
    path = 0.4 + 0.4 * np.sin(1.3 * t) + 0.1 * np.sin(3.1 * t)
    q, u = np.empty(len(t)), np.empty(len(t))
    d.qpos[:] = path[0]
    for k in range(len(t)):
        q[k] = d.qpos[0]
        d.ctrl[:] = u[k] = 40.0 * (path[k] - q[k]) - 3.0 * d.qvel[0] - 2.45 * np.cos(q[k])
        mujoco.mj_step(m, d, round(1.0 / (RATE * m.opt.timestep)))
    q += rng.normal(0.0, 1e-4, q.shape)
    return Recording(t, {"ctrl/drive": u, "qpos/shoulder": q})


@pytest.mark.parametrize(
    "spring", [f' stiffness="{STIFFNESS}" springref="{REST}"', ""], ids=["spring", "none"]
)
def test_a_spring_is_no_encoders_zero(spring: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(spring=""))
    found = check(Scene(path), recorded(ARM.format(spring=spring))).findings
    assert not [f.kind for f in found if f.sure]


def test_a_quarter_turn_is_found_where_the_weight_shows_it(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(spring=""))
    recording = recorded(ARM.format(spring=""))
    turned = recording.columns["qpos/shoulder"] - 0.5 * np.pi
    recording = replace(recording, columns={**recording.columns, "qpos/shoulder": turned})
    found = check(Scene(path), recording).findings
    assert [(f.kind, f.columns) for f in found if f.sure] == [("encoder_zero", ("qpos/shoulder",))]


def test_a_zero_beyond_the_joints_limits(tmp_path: Path) -> None:
    """Its stop would hold a joint there, and no joint gets there."""
    xml = MACHINES["rod"].xml.replace('name="hinge"', 'name="hinge" range="-1.2 1.2"', 1)
    (tmp_path / "m.xml").write_text(xml)
    clean = record("rod", 12, robot=xml)
    off = with_columns(clean, {"qpos/hinge": clean.columns["qpos/hinge"] + math.pi})
    checked = check(Scene(tmp_path / "m.xml"), off)
    assert [f.kind for f in checked.findings] == ["encoder_zero"]
