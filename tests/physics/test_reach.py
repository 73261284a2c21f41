"""What is close to a floor: points on the machine's surfaces, and nothing that is fixed itself."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.physics.reach import points_near, reaching

# the post stands on the floor by name: else two fixed geoms are never looked at
SPHERE_AND_POST = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="post" pos="1 0 0.05"><geom name="post" type="box" size="0.1 0.1 0.1"/></body>
    <body name="ball" pos="0 0 0.13"><freejoint/><geom type="sphere" size="0.1"/></body>
  </worldbody>
  <contact><pair geom1="floor" geom2="post"/></contact>
</mujoco>
"""


@pytest.mark.parametrize("height, near", [(0.13, True), (0.5, False)])
def test_the_machine_is_seen_and_what_is_fixed_is_not(height: float, near: bool) -> None:
    model = reaching(mujoco.MjModel.from_xml_string(SPHERE_AND_POST), 0.1, 0)
    data = mujoco.MjData(model)
    data.qpos[2] = height
    mujoco.mj_fwdPosition(model, data)
    assert data.ncon > near
    points, bodies, distance = points_near(model, data, 0)
    assert points == pytest.approx(np.array([[0.0, 0.0, height - 0.1]] * near).reshape(-1, 3))
    assert distance == pytest.approx([height - 0.1] * near)
    assert bodies.tolist() == [model.body("ball").id] * near


def test_nothing_near_is_no_point() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert [len(x) for x in points_near(model, data, 0)] == [0, 0, 0]
