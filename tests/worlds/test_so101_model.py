"""The SO-101's MJCF against the published figures."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.conftest import FromShared
from wt.data.importers import sage_so101
from wt.worlds import so101_model
from wt.worlds.so101_model import JOINTS, LIMITS, ServoPhysics


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return so101_model.build(ServoPhysics(), 0.0025)


def test_published_masses_limits_and_servo(model: mujoco.MjModel) -> None:
    masses = [0.147, 0.100006, 0.103, 0.104, 0.079, 0.087, 0.012]
    np.testing.assert_allclose(model.body_mass[1:], masses)
    degrees = [[-110, 110], [-100, 100], [-96.83, 96.83], [-95, 95], [-157.21, 162.79], [-10, 100]]
    np.testing.assert_allclose(np.rad2deg(model.jnt_range), degrees, atol=0.01)
    assert [model.joint(i).name for i in range(6)] == list(JOINTS)
    assert [model.actuator(i).name for i in range(6)] == list(JOINTS)
    np.testing.assert_allclose(model.actuator_forcerange, [[-2.94, 2.94]] * 6)
    np.testing.assert_allclose(model.dof_damping, 0.60)
    np.testing.assert_allclose(model.dof_frictionloss, 0.052)
    np.testing.assert_allclose(model.dof_armature, 0.028)
    # force = 17.8·(u - q), no velocity term
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], 17.8)
    np.testing.assert_allclose(model.actuator_biasprm[:, :3], [[0.0, -17.8, 0.0]] * 6)


# Read off the maker's file with MuJoCo: its site gripperframe and the whole arm's centre of mass.
POSES = [
    ([0, 0, 0, 0, 0, 0], [0.391362, -1.1e-05, 0.226469], [0.143249, 0.001215, 0.159957]),
    ([0.5, -0.4, 0.8, -0.6, 1.1, 0.3], [0.294669, -0.147903, 0.21142],
     [0.103986, -0.036843, 0.142607]),
    ([-1.2, 0.9, -0.7, 0.5, -2, 1], [0.174858, 0.369017, 0.042991],
     [0.087048, 0.140218, 0.101071]),
]  # fmt: skip


@pytest.mark.parametrize(("pose", "tip", "com"), POSES)
def test_published_frames(
    model: mujoco.MjModel, pose: list[float], tip: list[float], com: list[float]
) -> None:
    data = mujoco.MjData(model)
    data.qpos = pose
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.site(so101_model.TIP).xpos, tip, atol=2e-6)
    np.testing.assert_allclose(data.subtree_com[0], com, atol=2e-6)


def test_inertias_of_the_published_file(model: mujoco.MjModel, from_shared: FromShared) -> None:
    file = from_shared("models/so101/so101_trimmed.xml")
    published = mujoco.MjModel.from_xml_path(str(file))
    rng = np.random.default_rng(0)
    for _ in range(3):
        matrices, biases = [], []
        pose = rng.uniform(*published.jnt_range.T)
        speed = rng.normal(size=6)
        for m in (model, published):
            data = mujoco.MjData(m)
            data.qpos, data.qvel = pose, speed
            mujoco.mj_forward(m, data)
            torque = np.empty(6)
            columns = []
            for unit in np.eye(6):
                mujoco.mj_mulM(m, data, torque, unit)
                columns.append(torque.copy())
            matrices.append(columns)
            biases.append(data.qfrc_bias.copy())
        np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-7)
        np.testing.assert_allclose(biases[0], biases[1], atol=1e-5)


def test_geoms_are_for_drawing_only(model: mujoco.MjModel) -> None:
    assert model.ngeom == 7
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_the_importer_agrees_on_the_jaw() -> None:
    assert LIMITS["gripper"] == sage_so101.JAW_RANGE
    assert tuple(sage_so101.JOINTS.values()) == JOINTS
