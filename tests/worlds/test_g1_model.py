"""The G1's MJCF against the published figures."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from tests.conftest import FromShared
from tests.worlds.legged_checks import (
    hinges,
    published,
    random_poses,
    run,
    same_dynamics,
    same_inertials,
    standing,
    touching,
    upward,
)
from wt.errors import ConfigError
from wt.worlds import g1_model
from wt.worlds.g1_model import DEFAULT, FEET, JOINTS, PUBLISHED, TRUNK, build
from wt.worlds.legged_model import GYRO

SOLES = {f"{foot}{i}" for foot in FEET for i in (1, 2)}
FILES = (
    "g1/mjlab_g1.xml",
    "g1/unitree_rl_gym_g1_29dof_rev_1_0.xml",
    "g1/unitree_rl_mjlab_g1.xml",
)
SIDES = ("left", "right")


def planetary(rotors: tuple[float, float, float], first: float, second: float) -> float:
    """Inertia of a motor's three rotating parts behind two gear stages [kg·m²]."""
    return rotors[0] * (first * second) ** 2 + rotors[1] * second**2 + rotors[2]


# The maker's motors: rotor inertias [kg·m²] and planetary gears.
SMALL = planetary((0.139e-4, 0.017e-4, 0.169e-4), 1 + 46 / 18, 1 + 56 / 16)
MEDIUM = planetary((0.489e-4, 0.098e-4, 0.533e-4), 4.5, 1 + 48 / 22)
LARGE = planetary((0.489e-4, 0.109e-4, 0.738e-4), 4.5, 5)
TINY = planetary((0.068e-4, 0.0, 0.0), 5, 5)
# end of the joint's name: link's mass [kg], rotor inertia [kg·m²], torque [N·m], left limits [rad]
TABLE = {
    "hip_pitch": (1.35, MEDIUM, 88, (-2.5307, 2.8798)),
    "hip_roll": (1.52, LARGE, 139, (-0.5236, 2.9671)),
    "hip_yaw": (1.702, MEDIUM, 88, (-2.7576, 2.7576)),
    "knee": (1.932, LARGE, 139, (-0.087267, 2.8798)),
    "ankle_pitch": (0.074, 2 * SMALL, 50, (-0.87267, 0.5236)),
    "ankle_roll": (0.608, 2 * SMALL, 50, (-0.2618, 0.2618)),
    "waist_yaw": (0.214, MEDIUM, 88, (-2.618, 2.618)),
    "waist_roll": (0.086, 2 * SMALL, 50, (-0.52, 0.52)),
    "waist_pitch": (7.818, 2 * SMALL, 50, (-0.52, 0.52)),
    "shoulder_pitch": (0.718, SMALL, 25, (-3.0892, 2.6704)),
    "shoulder_roll": (0.643, SMALL, 25, (-1.5882, 2.2515)),
    "shoulder_yaw": (0.734, SMALL, 25, (-2.618, 2.618)),
    "elbow": (0.6, SMALL, 25, (-1.0472, 2.0944)),
    "wrist_roll": (0.085445, SMALL, 25, (-1.97222, 1.97222)),
    "wrist_pitch": (0.48405, TINY, 5, (-1.61443, 1.61443)),
    "wrist_yaw": (0.254576, TINY, 5, (-1.61443, 1.61443)),
}
LEG, WAIST, ARM = list(TABLE)[:6], list(TABLE)[6:9], list(TABLE)[9:]


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build(PUBLISHED, 0.005)


def test_order_of_the_joints(model: mujoco.MjModel) -> None:
    order = [f"{side}_{part}" for side in SIDES for part in LEG] + WAIST
    order += [f"{side}_{part}" for side in SIDES for part in ARM]
    assert list(JOINTS) == [f"{name}_joint" for name in order]
    assert hinges(model) == list(JOINTS)
    assert [model.actuator(i).name for i in range(29)] == list(JOINTS)
    np.testing.assert_array_equal(model.actuator_trnid[:, 0], np.arange(1, 30))


def test_published_masses_limits_torques_and_drives(model: mujoco.MjModel) -> None:
    assert model.body_mass.sum() == pytest.approx(33.3411, abs=5e-5)
    assert model.body(TRUNK).mass[0] == 3.813
    for name in JOINTS:
        part = name.removesuffix("_joint").removeprefix("left_").removeprefix("right_")
        mass, rotor, torque, (low, high) = TABLE[part]
        if name.startswith("right") and part.endswith(("roll", "yaw")):
            low, high = -high, -low
        joint, actuator = model.joint(name), model.actuator(name)
        assert model.body_mass[model.jnt_bodyid[joint.id]] == mass
        np.testing.assert_allclose(joint.range, (low, high))
        np.testing.assert_allclose(actuator.forcerange, (-torque, torque))
        assert joint.armature[0] == pytest.approx(rotor, rel=1e-4)  # five digits are published
        # 10 Hz and a damping ratio of 2 with the rotor alone
        gain = actuator.gainprm[0]
        assert np.sqrt(gain / joint.armature[0]) / (2 * np.pi) == pytest.approx(10.0)
        assert -actuator.biasprm[2] / (2 * np.sqrt(gain * joint.armature[0])) == pytest.approx(2.0)
        assert actuator.biasprm[1] == -gain
    np.testing.assert_allclose(model.dof_frictionloss[6:], 0.1)
    assert not model.dof_armature[:6].any()


@pytest.mark.parametrize("file", FILES)
def test_inertias_and_frames_of_the_published_files(
    model: mujoco.MjModel, from_shared: FromShared, file: str
) -> None:
    theirs = published(from_shared(f"models/{file}"))
    names = [model.body(b).name for b in range(1, model.nbody)]
    assert names == [theirs.body(b).name for b in range(1, theirs.nbody)]
    same_inertials(model, theirs, {name: name for name in names})
    sole = model.site("left_foot").pos
    same_dynamics(model, theirs, {f"{side}_ankle_roll_link": sole for side in SIDES}, seed=5)


def test_soles_lie_where_the_published_ones_do(
    model: mujoco.MjModel, from_shared: FromShared
) -> None:
    theirs = published(from_shared("models/g1/unitree_rl_gym_g1_29dof_rev_1_0.xml"))
    body = theirs.body("left_ankle_roll_link").id
    spheres = theirs.geom_pos[theirs.geom_bodyid == body]
    ends = []
    for name in SOLES - {"right_foot1", "right_foot2"}:
        geom, turn = model.geom(name), np.empty(9)
        mujoco.mju_quat2Mat(turn, geom.quat)
        ends += [geom.pos + sign * geom.size[1] * turn[2::3] for sign in (-1, 1)]
        assert geom.pos[2] - geom.size[0] == pytest.approx(spheres[0, 2] - 0.005)
    np.testing.assert_allclose(
        sorted(tuple(p[:2].round(9)) for p in ends), sorted(map(tuple, spheres[:, :2])), atol=1e-9
    )
    bottom = spheres[0, 2] - 0.005
    assert model.site("left_foot").pos[2] == pytest.approx(bottom)


def test_only_some_parts_meet_the_ground_and_never_the_robot() -> None:
    robot = build(PUBLISHED, 0.005, floor=False)
    listening = robot.geom_bodyid[robot.geom_conaffinity > 0]
    assert {robot.body(b).name for b in listening} == {
        TRUNK, "torso_link", *(f"{side}_{p}_link" for side in SIDES for p in ("knee", "ankle_roll"))
    }  # fmt: skip
    assert not robot.geom_contype.any()
    data = mujoco.MjData(robot)
    for pose in random_poses(robot, 20, seed=0):
        data.qpos = pose
        mujoco.mj_forward(robot, data)
        assert data.ncon == 0


def test_default_pose(model: mujoco.MjModel) -> None:
    pose = dict(zip(JOINTS, DEFAULT, strict=True))
    for side in SIDES:
        assert [pose[f"{side}_{part}_joint"] for part in LEG] == [-0.312, 0, 0, 0.669, -0.363, 0]
        assert pose[f"{side}_elbow_joint"] == 0.6
        assert pose[f"{side}_shoulder_pitch_joint"] == 0.2
        assert pose[f"{side}_shoulder_roll_joint"] == (0.2 if side == "left" else -0.2)
    assert np.count_nonzero(DEFAULT) == 12
    data = standing(model)
    low, high = model.jnt_range[1:].T
    assert ((low < DEFAULT) & (high > DEFAULT)).all()
    soles = [data.site(foot).xpos for foot in FEET]
    np.testing.assert_allclose([p[2] for p in soles], 0.0, atol=2e-3)
    # its weight is above its soles, a thumb's breadth from their middle
    np.testing.assert_allclose(data.subtree_com[0][:2], np.mean(soles, axis=0)[:2], atol=0.02)


def test_stands_half_a_second_and_then_falls_without_sinking(model: mujoco.MjModel) -> None:
    """Position targets alone do not balance it.

    Two ankles of 28.5 N·m/rad are a quarter of what its weight topples with, m·g·h = 212 N·m/rad.
    """
    data = standing(model)
    run(model, data, 0.5)
    assert touching(model, data) == SOLES
    assert data.qpos[2] > 0.7
    assert upward(data, TRUNK) > 0.99
    run(model, data, 4.5)
    assert upward(data, TRUNK) < 0.5
    assert data.geom_xpos[model.geom_conaffinity > 0, 2].min() > 0
    assert data.qpos[2] > 0.03
    assert np.abs(data.qvel).max() < 1.0


@pytest.mark.parametrize("timestep", [0.002, 0.004, 0.005])
def test_flailing_does_not_explode(timestep: float) -> None:
    robot = build(PUBLISHED, timestep)
    data = standing(robot)
    rng = np.random.default_rng(0)
    for _ in range(100):
        data.ctrl = DEFAULT + rng.normal(scale=0.5, size=29)
        run(robot, data, 0.02)
        assert np.abs(data.qvel).max() < 60


@pytest.mark.parametrize("edge", [0.0, 0.05])
def test_the_edge_of_a_block_carries_the_middle_of_the_soles(edge: float) -> None:
    """A block under the heels ends between heel and toe: where it ends, the soles are carried."""
    spec = g1_model.spec(dataclasses.replace(PUBLISHED, floor_friction=0.8), 0.005, floor=False)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.5, 1, 0.1), pos=(edge - 0.5, 0, -0.1)
    )
    robot = spec.compile()
    data = standing(robot)
    assert touching(robot, data) <= SOLES
    for _ in range(20):
        run(robot, data, 0.005)
    assert touching(robot, data) == SOLES
    assert data.contact.pos[:, 0].max() == pytest.approx(edge, abs=0.01)
    assert data.contact.dist.min() > -0.01
    np.testing.assert_allclose(data.contact.friction[:, :2], 0.8)


def test_every_number_arrives(model: mujoco.MjModel) -> None:
    rows = {
        name: tuple(100.0 * k + i + 1 for i in range(29))
        for k, name in enumerate(("stiffness", "velocity_gain", "damping", "frictionloss"))
    }
    scaled = dataclasses.replace(PUBLISHED, **rows, trunk_mass_scale=1.2, limb_mass_scale=0.7)
    robot = build(scaled, 0.004)
    np.testing.assert_allclose(robot.actuator_gainprm[:, 0], rows["stiffness"])
    np.testing.assert_allclose(robot.actuator_biasprm[:, 2], -np.array(rows["velocity_gain"]))
    np.testing.assert_allclose(robot.dof_damping[6:], rows["damping"])
    np.testing.assert_allclose(robot.dof_frictionloss[6:], rows["frictionloss"])
    trunk = {TRUNK, "waist_yaw_link", "waist_roll_link", "torso_link"}
    for b in range(1, robot.nbody):
        factor = 1.2 if robot.body(b).name in trunk else 0.7
        assert robot.body_mass[b] == pytest.approx(factor * model.body_mass[b])
        np.testing.assert_allclose(robot.body_inertia[b], factor * model.body_inertia[b])


def test_refuses_gains_of_another_robot() -> None:
    physics = dataclasses.replace(PUBLISHED, stiffness=(50.0,) * 12)
    with pytest.raises(ConfigError, match="29 joints has 12 values"):
        build(physics, 0.005)


def test_gyro(model: mujoco.MjModel) -> None:
    data = standing(model)
    data.qvel[3:6] = (0.3, -0.2, 0.5)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.sensor(GYRO).data, (0.3, -0.2, 0.5), atol=1e-12)
