"""What a step leaves out where it has nothing to do changes no bit of it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.physics.lean import rest_idle

CONTACT, CONSTRAINT, ISLAND = (
    int(mujoco.mjtDisableBit.mjDSBL_CONTACT),
    int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT),
    int(mujoco.mjtDisableBit.mjDSBL_ISLAND),
)
ARM = """<mujoco><option timestep=".001" integrator="implicitfast"/><worldbody>{floor}
<body><joint name="a" axis="0 1 0" damping=".1" {joint}/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" {geom}/>
<body pos=".3 0 0"><joint name="b" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" {geom}/></body></body></worldbody>
<actuator><position joint="a" kp="40" kv="2"/></actuator></mujoco>"""
FLOOR, UNTOUCHED = '<geom type="plane" size="1 1 .1" pos="0 0 -.4"/>', 'contype="0" conaffinity="0"'


@pytest.mark.parametrize(
    ("floor", "joint", "geom", "off"),
    [
        ("", "", UNTOUCHED, CONTACT | CONSTRAINT),
        (FLOOR, "", UNTOUCHED, CONTACT | CONSTRAINT),
        ("", 'frictionloss=".2"', UNTOUCHED, CONTACT | ISLAND),
        ("", 'range="-10 10"', UNTOUCHED, CONTACT | ISLAND),
        (FLOOR, "", "", 0),
        ("", "", 'contype="2" conaffinity="4"', CONTACT | CONSTRAINT),
        ("", "", 'contype="2" conaffinity="2"', 0),
    ],
)
def test_idle_stages_rest_and_the_motion_stays(floor: str, joint: str, geom: str, off: int) -> None:
    paths = []
    for rest in (False, True):
        model = mujoco.MjModel.from_xml_string(ARM.format(floor=floor, joint=joint, geom=geom))
        if rest:
            rest_idle(model)
            assert model.opt.disableflags == off
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.7
        path = []
        for _ in range(500):
            mujoco.mj_step(model, data)
            path.append((data.qpos.copy(), data.qvel.copy()))
        paths.append(np.array(path))
    np.testing.assert_array_equal(*paths)


def test_a_pair_that_is_named_may_touch() -> None:
    xml = ARM.format(floor="", joint="", geom=UNTOUCHED).replace("<geom", '<geom name="g1"', 1)
    xml = xml.replace("<geom type", '<geom name="g2" type', 1)
    pair = '<contact><pair geom1="g1" geom2="g2"/></contact></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml.replace("</mujoco>", pair))
    rest_idle(model)
    assert model.opt.disableflags == 0
