"""Parts that a patch adds have MuJoCo's own values, whatever the main class says."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

from wt.mjcf.compare import as_written
from wt.physics import parts

STRETCHED = """<mujoco>
  <default><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25"/>
    <site type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25"/></default>
  <worldbody><body name="b"><joint name="j" axis="0 1 0"/><geom name="g"/></body></worldbody>
</mujoco>"""


def read_back(spec: mujoco.MjSpec) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ET.tostring(as_written(spec), encoding="unicode"))


def test_a_sphere_is_one_where_the_main_class_is_stretched() -> None:
    spec = mujoco.MjSpec.from_string(STRETCHED)
    load = parts.add_body(spec, spec.body("b"), "load", pos=[0.1, 0.0, 0.2])
    parts.add_geom(spec, load, "ball", size=[0.03, 0.0, 0.0], mass=0.5, pos=[0.0, 0.1, 0.0])
    parts.add_site(spec, load, "mark", pos=[0.0, 0.1, 0.0])
    for model in (spec.compile(), read_back(spec)):
        np.testing.assert_allclose(model.geom("ball").size, 0.03)
        np.testing.assert_allclose(model.geom("ball").pos, [0.0, 0.1, 0.0], atol=1e-12)
        # a solid sphere: 2/5 m r²
        np.testing.assert_allclose(model.body("load").inertia, 0.4 * 0.5 * 0.03**2)
        np.testing.assert_allclose(model.site("mark").pos, [0.0, 0.1, 0.0], atol=1e-12)
        np.testing.assert_allclose(model.site("mark").quat, [1.0, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("rule", ['settotalmass="3"', 'boundmass="0.4"', 'boundinertia="0.3"'])
def test_no_rule_of_the_compiler_weighs_what_is_added(rule: str) -> None:
    text = STRETCHED.replace("<default>", f"<compiler {rule}/><default>")
    given = mujoco.MjModel.from_xml_string(text)
    spec = mujoco.MjSpec.from_string(text)
    load = parts.add_body(spec, spec.body("b"), "load")
    parts.add_geom(spec, load, "ball", size=[0.03, 0.0, 0.0], mass=0.1)
    for model in (spec.compile(), read_back(spec)):
        assert model.body("load").mass[0] == pytest.approx(0.1)
        assert model.body("load").inertia[0] == pytest.approx(0.4 * 0.1 * 0.03**2)
        assert model.body("b").mass[0] == pytest.approx(given.body("b").mass[0])
        np.testing.assert_allclose(model.body("b").inertia, given.body("b").inertia, rtol=1e-5)
