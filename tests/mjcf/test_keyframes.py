"""A reset to the user's keyframe is at rest also where the patch added joints and filters."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.mjcf.written import load, write
from tests.physics.arm import ARM
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

KEY = '<keyframe><key name="home" qpos="0.1 -1.2 1.5" ctrl="0.1 -1.2 1.5"/></keyframe></mujoco>'
HELD = ARM.replace("</mujoco>", KEY).replace("0 0 -9.81", "0 0 0")
FOUND = [
    ("joint.backlash", "joint", "j0", [0.04, 0.3]),
    ("joint.elasticity", "joint", "j1", [150.0, 0.5, 0.0]),
    ("actuator.lag", "actuator", "m2", [0.05]),
]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_reset_to_the_users_keyframe_is_at_rest(count: int, tmp_path: Path) -> None:
    hypothesis = [
        Planted(effects()[name], Location(kind, at), np.array(theta))  # type: ignore[arg-type]
        for name, kind, at, theta in FOUND[:count]
    ]
    model, _ = load(write(tmp_path, hypothesis, HELD))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for joint, angle in (("j0", 0.1), ("j1", -1.2), ("j2", 1.5)):
        assert data.joint(joint).qpos[0] == pytest.approx(angle)
    fastest = 0.0
    for _ in range(400):
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(np.abs(data.qvel).max()))
    assert fastest < 1e-6


def test_a_keyframe_under_load_has_the_gear_wound_up(tmp_path: Path) -> None:
    loaded = ARM.replace("</mujoco>", KEY.replace('ctrl="0.1 -1.2 1.5"', 'ctrl="0.1 -1.0 1.5"'))
    elastic = Planted(
        effects()["joint.elasticity"], Location("joint", "j1"), np.array([150.0, 0.5, 0.0])
    )
    model, _ = load(write(tmp_path, [elastic], loaded))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    twist = data.joint("j1_rotor").qpos[0] + 1.2
    assert 150.0 * twist == pytest.approx(60.0 * (0.2 - twist), rel=1e-6)


def test_keyframes_stay_as_they_were_written_where_nothing_was_added(tmp_path: Path) -> None:
    stiff = Planted(effects()["joint.stiffness"], Location("joint", "j1"), np.array([2.0, 0.4]))
    text = (write(tmp_path, [stiff], HELD) / "model.xml").read_text()
    assert KEY.removesuffix("</mujoco>") in text
