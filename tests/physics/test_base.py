"""A free joint in six numbers is the same machine."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics import stool
from wt.physics import base
from wt.physics.scene import Scene
from wt.types import Location


def test_accelerations_are_those_of_the_free_joint(tmp_path: Path) -> None:
    scene, rng = stool.scene(tmp_path), np.random.default_rng(0)
    one, other = scene.model, scene.given
    a, b = mujoco.MjData(one), mujoco.MjData(other)
    a.qpos[:6] = 0.3, -0.2, 1.0, 2.0, 0.5, -0.7
    a.qpos[6:] = rng.uniform(-0.5, 0.5, 6)
    a.qvel[:] = rng.normal(size=12)
    mujoco.mj_forward(one, a)
    spin = np.zeros(6)
    mujoco.mj_objectVelocity(
        one, a, mujoco.mjtObj.mjOBJ_XBODY, one.body("trunk").id, spin, flg_local=0
    )
    turned = a.body("trunk").xmat.reshape(3, 3)
    b.qpos[:7], b.qpos[7:] = base.pose(a.qpos[:6]), a.qpos[6:]
    b.qvel[:3], b.qvel[3:6], b.qvel[6:] = a.qvel[:3], turned.T @ spin[:3], a.qvel[6:]
    mujoco.mj_forward(other, b)
    assert b.qacc[:3] == pytest.approx(a.qacc[:3], abs=1e-9)
    assert b.qacc[6:] == pytest.approx(a.qacc[6:], abs=1e-9)
    assert base.rates(a.qpos[None, 3:6], b.qvel[None, 3:6])[0] == pytest.approx(a.qvel[3:6])


def test_a_recorded_pose_comes_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    six = np.cumsum(0.05 * rng.normal(size=(200, 6)), axis=0)
    six[:, 3] += np.linspace(0, 12, 200)  # it turns round more than once
    pose = base.pose(six)
    pose[::3, 3:] *= -1.0  # either sign of a quaternion is the same rotation
    columns = {f"qpos/root/{k}": pose[:, k] for k in range(7)}
    columns["qpos/root/5"][7] = np.nan
    found = base.coordinates("root", columns)
    table = np.stack([found[f"qpos/{name}"] for name in base.names("root")], axis=1)
    known = np.arange(200) != 7
    assert np.isnan(table[7, 3:]).all()
    assert table[known] == pytest.approx(six[known], abs=1e-9)
    assert "qvel/root/x" not in found


def test_a_scene_tells_its_own_joints_from_its_base(tmp_path: Path) -> None:
    scene = stool.scene(tmp_path)
    assert scene.free == ("root",)
    assert scene.own_joints == stool.JOINTS
    assert scene.joints == (*base.names("root"), *stool.JOINTS)
    assert scene.place("rear_hip") == Location("joint", "rear_hip")
    assert scene.place("root/yaw") == Location("body", "trunk")


def test_a_free_joint_without_a_name_goes_by_its_id(tmp_path: Path) -> None:
    path = tmp_path / "nameless.xml"
    path.write_text(stool.STOOL.replace('<freejoint name="root"/>', "<freejoint/>"))
    assert Scene(path).free == ("joint0",)
