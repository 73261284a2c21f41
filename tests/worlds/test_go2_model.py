"""The Go2's MJCF against the published figures, and its ball against rigid-body mechanics."""

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
from wt.worlds import go2_model, legged_model
from wt.worlds.go2_model import (
    BALL,
    BOX,
    DEFAULT,
    FEET,
    JOINTS,
    LEGS,
    PUBLISHED,
    TRUNK,
    BallPayload,
    build,
)
from wt.worlds.legged_model import GYRO, ORIENTATION

# part: mass [kg], limits front and rear [rad], torque [N·m]
TABLE = {
    "hip": (0.678, (-1.0472, 1.0472), (-1.0472, 1.0472), 23.7),
    "thigh": (1.152, (-1.5708, 3.4907), (-0.5236, 4.5379), 23.7),
    "calf": (0.241352, (-2.7227, -0.83776), (-2.7227, -0.83776), 45.43),
}
FILES = {
    "go2/menagerie_go2.xml": "base",
    "go2/menagerie_go2_mjx.xml": "base",
    "go2/unitree_mujoco_go2.xml": "base_link",
    "go2/unitree_rl_mjlab_go2.xml": "base_link",
}
PAYLOAD = BallPayload()
BALL_DOFS = slice(18, 24)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build(PUBLISHED, 0.005)


@pytest.fixture(scope="module")
def loaded() -> mujoco.MjModel:
    return build(PUBLISHED, 0.005, PAYLOAD)


def test_published_masses_limits_and_torques(model: mujoco.MjModel) -> None:
    assert model.body_mass.sum() == pytest.approx(15.2064, abs=5e-5)
    assert model.body(TRUNK).mass[0] == 6.921
    assert hinges(model) == list(JOINTS)
    assert [model.actuator(i).name for i in range(12)] == list(JOINTS)
    assert JOINTS[:3] == ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")
    assert JOINTS[3::3] == ("FR_hip_joint", "RL_hip_joint", "RR_hip_joint")
    for leg in LEGS:
        for part, (mass, front, rear, torque) in TABLE.items():
            name = f"{leg}_{part}_joint"
            joint, actuator = model.joint(name), model.actuator(name)
            assert model.body(f"{leg}_{part}").mass[0] == mass
            np.testing.assert_allclose(joint.range, front if leg[0] == "F" else rear)
            np.testing.assert_allclose(actuator.forcerange, (-torque, torque))
            np.testing.assert_allclose(joint.axis, (1, 0, 0) if part == "hip" else (0, 1, 0))
            assert joint.limited[0] and joint.armature[0] == 0.01
            assert actuator.trnid[0] == joint.id
    assert not model.dof_armature[:6].any()


@pytest.mark.parametrize("file", FILES)
def test_inertias_and_frames_of_the_published_files(
    model: mujoco.MjModel, from_shared: FromShared, file: str
) -> None:
    theirs = published(from_shared(f"models/{file}"))
    parts = [f"{leg}_{part}" for leg in LEGS for part in TABLE]
    same_inertials(model, theirs, {TRUNK: FILES[file], **{name: name for name in parts}})
    foot = model.geom("FL_foot").pos
    same_dynamics(model, theirs, {f"{leg}_calf": foot for leg in LEGS}, seed=3)


def test_feet_are_those_of_menagerie(model: mujoco.MjModel, from_shared: FromShared) -> None:
    theirs = published(from_shared("models/go2/menagerie_go2.xml"))
    for leg, foot in zip(LEGS, FEET, strict=True):
        np.testing.assert_allclose(model.geom(foot).pos, theirs.geom(leg).pos)
        assert model.geom(foot).size[0] == theirs.geom(leg).size[0]
        np.testing.assert_allclose(model.site(foot).pos, model.geom(foot).pos)
    np.testing.assert_allclose(DEFAULT, theirs.key("home").qpos[7:])


def test_only_feet_knees_and_trunk_meet_the_ground_and_never_the_robot() -> None:
    robot = build(PUBLISHED, 0.005, floor=False)
    listening = [g for g in range(robot.ngeom) if robot.geom_conaffinity[g]]
    bodies = sorted(robot.body(robot.geom_bodyid[g]).name for g in listening)
    assert bodies == sorted([TRUNK, *(f"{leg}_calf" for leg in LEGS for _ in range(2))])
    assert not robot.geom_contype.any()
    data = mujoco.MjData(robot)
    for pose in random_poses(robot, 20, seed=0):
        data.qpos = pose
        mujoco.mj_forward(robot, data)
        assert data.ncon == 0


def test_stands(model: mujoco.MjModel) -> None:
    data = standing(model)
    assert touching(model, data) == set(FEET)
    assert -1e-3 < data.contact.dist.min() < 0
    run(model, data, 2.0)
    assert touching(model, data) == set(FEET)
    assert data.qpos[2] == pytest.approx(0.257, abs=0.01)  # sags under its weight
    assert np.abs(data.qpos[7:] - DEFAULT).max() < 0.2
    assert upward(data, TRUNK) > 0.995
    assert np.abs(data.qvel).max() < 0.02
    # the ground carries the weight
    force = np.zeros(6)
    total = 0.0
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        total += force[0]
    assert total == pytest.approx(15.2064 * 9.81, rel=0.01)


def test_stands_on_terrain_with_the_friction_that_was_asked_for() -> None:
    spec = go2_model.spec(dataclasses.replace(PUBLISHED, floor_friction=0.37), 0.005, floor=False)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=(1, 1, 0.1), pos=(0, 0, -0.1))
    robot = spec.compile()
    data = standing(robot)
    run(robot, data, 1.0)
    assert touching(robot, data) == set(FEET)
    np.testing.assert_allclose(data.contact.friction[:, :2], 0.37)
    assert (data.contact.dim == 3).all()


@pytest.mark.parametrize("roll", [np.pi / 2, np.pi, 2.0])
def test_a_fallen_robot_does_not_sink(model: mujoco.MjModel, roll: float) -> None:
    data = standing(model)
    data.qpos[2] = 0.4
    mujoco.mju_euler2Quat(data.qpos[3:7], np.array([roll, 0.3, 0.0]), "xyz")
    run(model, data, 2.0)
    assert data.qpos[2] > 0.04
    assert (data.geom("FL_foot").xpos[2]) > 0.01


def test_imu(model: mujoco.MjModel) -> None:
    data = standing(model)
    data.qpos[3:7] = np.array([0.8, 0.0, 0.6, 0.0])
    data.qvel[3:6] = (0.3, -0.2, 0.5)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.sensor(GYRO).data, (0.3, -0.2, 0.5), atol=1e-12)
    np.testing.assert_allclose(data.sensor(ORIENTATION).data, data.qpos[3:7], atol=1e-12)


def test_every_number_arrives(model: mujoco.MjModel) -> None:
    rows = {
        name: tuple(10.0 * k + i + 1 for i in range(12))
        for k, name in enumerate(("stiffness", "velocity_gain", "damping", "frictionloss"))
    }
    robot = build(
        dataclasses.replace(PUBLISHED, **rows, trunk_mass_scale=1.2, limb_mass_scale=0.7),
        0.004, PAYLOAD,
    )  # fmt: skip
    assert robot.opt.timestep == 0.004
    np.testing.assert_allclose(robot.actuator_gainprm[:, 0], rows["stiffness"])
    np.testing.assert_allclose(robot.actuator_biasprm[:, 1], -np.array(rows["stiffness"]))
    np.testing.assert_allclose(robot.actuator_biasprm[:, 2], -np.array(rows["velocity_gain"]))
    np.testing.assert_allclose(robot.dof_damping[6:18], rows["damping"])
    np.testing.assert_allclose(robot.dof_frictionloss[6:18], rows["frictionloss"])
    for dofs in (slice(6), BALL_DOFS):
        assert not robot.dof_damping[dofs].any() and not robot.dof_frictionloss[dofs].any()
    factor = np.full(13, 0.7)
    factor[0] = 1.2
    links = slice(1, 14)
    np.testing.assert_allclose(robot.body_mass[links] / model.body_mass[links], factor)
    ratio = robot.body_inertia[links] / model.body_inertia[links]
    np.testing.assert_allclose(ratio, np.repeat(factor[:, None], 3, axis=1))
    assert robot.body(BALL).mass[0] == 5.0 and robot.body(BOX).mass[0] == 0.8


def test_one_value_holds_for_all(model: mujoco.MjModel) -> None:
    np.testing.assert_allclose(model.dof_damping[6:], 0.1)
    np.testing.assert_allclose(model.dof_frictionloss[6:], 0.2)
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], 50.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stiffness", ()),
        ("damping", (-0.1,)),
        ("velocity_gain", (float("nan"),)),
        ("frictionloss", (float("inf"),)),
        ("trunk_mass_scale", 0.0),
        ("limb_mass_scale", -1.0),
        ("floor_friction", float("nan")),
    ],
)
def test_refuses_impossible_physics(name: str, value: float | tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=name):
        dataclasses.replace(PUBLISHED, **{name: value})


def test_refuses_other_numbers_of_joints_and_no_time() -> None:
    physics = dataclasses.replace(PUBLISHED, damping=(0.1, 0.1, 0.1))
    with pytest.raises(ConfigError, match=r"damping of a robot with 12 joints has 3 values"):
        build(physics, 0.005)
    with pytest.raises(ConfigError, match="timestep"):
        build(PUBLISHED, 0.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("ball_mass", 0.0), ("box_mass", -1.0), ("width", 0.1), ("height", 0.05), ("length", np.nan)],
)
def test_refuses_impossible_payloads(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=name):
        BallPayload(**{name: value})
    if name == "height":
        BallPayload(height=value, lid=False)  # the ball may look out of an open box


def test_payload_comes_last(model: mujoco.MjModel, loaded: mujoco.MjModel) -> None:
    assert (loaded.nq, loaded.nv, loaded.nu) == (26, 24, 12)
    for name in ("base", *JOINTS):
        assert loaded.joint(name).qposadr[0] == model.joint(name).qposadr[0]
        assert loaded.joint(name).dofadr[0] == model.joint(name).dofadr[0]
    assert loaded.joint(BALL).qposadr[0] == 19
    assert loaded.body_mass.sum() == pytest.approx(15.2064 + 5.8, abs=5e-5)
    # a solid sphere
    inertia = 0.4 * PAYLOAD.ball_mass * PAYLOAD.ball_radius**2
    np.testing.assert_allclose(loaded.body(BALL).inertia, inertia)
    np.testing.assert_allclose(loaded.body(BALL).ipos, 0, atol=1e-15)


@pytest.mark.parametrize(("gain", "on_its_feet"), [(50.0, False), (100.0, True)])
def test_stands_with_the_ball(gain: float, on_its_feet: bool) -> None:
    """The ball rolls to the rear; with the gains of an unloaded robot the rear knees come down."""
    robot = build(dataclasses.replace(PUBLISHED, stiffness=(gain,)), 0.005, PAYLOAD)
    data = standing(robot)
    run(robot, data, 2.0)
    assert touching(robot, data) >= {*FEET, BALL, BOX}
    assert (touching(robot, data) == {*FEET, BALL, BOX}) == on_its_feet
    assert data.qpos[2] > 0.2
    assert upward(data, TRUNK) > 0.95
    assert outside(robot, data, PAYLOAD) < 0.005


def carried(payload: BallPayload, timestep: float, scale: float) -> mujoco.MjModel:
    """A robot whose trunk is so heavy that the ball cannot move it."""
    return build(dataclasses.replace(PUBLISHED, trunk_mass_scale=scale), timestep, payload, False)


def held(model: mujoco.MjModel) -> float:
    """Mass of all but the ball [kg]."""
    return float(model.body_mass.sum() - model.body(BALL).mass[0])


def test_the_ball_rolls_as_a_solid_sphere() -> None:
    """Down a slope a rolling solid sphere accelerates with 5/7 g sin θ."""
    payload = BallPayload(length=1.0)
    robot = carried(payload, 0.001, 1e6)
    data = standing(robot)
    angle = 0.1
    # gravity is tilted instead of the trunk, whose own weight is taken off
    robot.opt.gravity = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    data.xfrc_applied[robot.body(TRUNK).id, :3] = -held(robot) * robot.opt.gravity
    run(robot, data, 0.2)  # until the contact has settled
    before = data.qvel[18]
    run(robot, data, 0.5)
    assert (data.qvel[18] - before) / 0.5 == pytest.approx(5 / 7 * 9.81 * np.sin(angle), rel=0.01)
    assert data.qvel[22] == pytest.approx(data.qvel[18] / payload.ball_radius, rel=0.02)


def outside(model: mujoco.MjModel, data: mujoco.MjData, payload: BallPayload) -> float:
    """How far the ball sticks into a wall of its box [m]; negative within."""
    mujoco.mj_kinematics(model, data)
    trunk, ball = data.body(TRUNK), data.body(BALL)
    offset = trunk.xmat.reshape(3, 3).T @ (ball.xpos - trunk.xpos)
    offset[2] -= payload.floor_height + payload.height / 2
    room = np.array([payload.length, payload.width, payload.height]) / 2 - payload.ball_radius
    return float((np.abs(offset) - room).max())


@pytest.mark.parametrize("timestep", [0.004, 0.005])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_ball_stays_when_the_trunk_is_shaken(timestep: float, seed: int) -> None:
    """±15 cm and ±0.8 rad about each axis at up to 3 Hz: 7 g and 19 rad/s."""
    robot = carried(PAYLOAD, timestep, 1e3)
    data = standing(robot)
    rng = np.random.default_rng(seed)
    trunk = robot.body(TRUNK).id
    rate, phase = 2 * np.pi * rng.uniform(0.5, 3, 6), rng.uniform(0, 2 * np.pi, 6)
    reach = np.repeat([0.15, 0.8], 3)
    start, worst = data.qpos[:3].copy(), -1.0
    for k in range(round(4.0 / timestep)):
        swing, lead = reach * np.sin(rate * k * timestep + phase), min(1.0, k * timestep)
        speed = lead * reach * rate * np.cos(rate * k * timestep + phase)
        wanted = -lead * rate**2 * swing  # acceleration, then corrected for what was missed
        wanted[:3] += 20 * (speed[:3] - data.qvel[:3])
        wanted[:3] += 100 * (lead * swing[:3] + start - data.qpos[:3])
        turn, axes = data.xmat[trunk].reshape(3, 3), data.ximat[trunk].reshape(3, 3)
        spin = turn @ data.qvel[3:6]
        inertia = axes @ np.diag(robot.body_inertia[trunk]) @ axes.T
        data.xfrc_applied[trunk, :3] = held(robot) * (wanted[:3] - robot.opt.gravity)
        data.xfrc_applied[trunk, 3:] = inertia @ (wanted[3:] + 20 * (speed[3:] - spin))
        data.xfrc_applied[trunk, 3:] += np.cross(spin, inertia @ spin)
        run(robot, data, timestep)
        worst = max(worst, outside(robot, data, PAYLOAD))
    assert 0 < worst < 0.025  # it hits the walls, and its centre stays before them


@pytest.mark.parametrize("timestep", [0.004, 0.005])
def test_the_ball_stays_in_a_crash(timestep: float) -> None:
    """Dropped from a metre, tumbling, with thrashing legs."""
    robot = build(PUBLISHED, timestep, PAYLOAD)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        data = standing(robot)
        data.qpos[[2, 21]] += 1.0
        data.qvel[3:6] = rng.normal(scale=6.0, size=3)
        worst = -1.0
        for _ in range(round(2.0 / timestep)):
            data.ctrl = DEFAULT + rng.normal(scale=0.5, size=12)
            run(robot, data, timestep)
            worst = max(worst, outside(robot, data, PAYLOAD))
        assert worst < 0.025


@pytest.mark.parametrize("lid", [True, False])
def test_only_the_lid_holds_the_ball_upside_down(lid: bool) -> None:
    payload = BallPayload(lid=lid)
    robot = build(PUBLISHED, 0.005, payload, floor=False)
    data = standing(robot)
    robot.opt.gravity = (0.0, 0.0, 9.81)
    data.xfrc_applied[robot.body(TRUNK).id, 2] = -9.81 * held(robot)
    run(robot, data, 0.6)
    assert (outside(robot, data, payload) < 0.025) == lid


def test_nothing_but_the_box_touches_the_ball(loaded: mujoco.MjModel) -> None:
    data = standing(loaded)
    data.qpos[19:22] = (0.0, 0.0, -0.5)  # far below the floor, which lets it pass
    mujoco.mj_forward(loaded, data)
    assert touching(loaded, data) == set(FEET)


def test_rotors_can_be_lighter() -> None:
    light = go2_model.build(dataclasses.replace(go2_model.PUBLISHED, armature_scale=0.1), 0.002)
    np.testing.assert_allclose(light.dof_armature[6:], 0.001)
    with pytest.raises(ConfigError, match="armature_scale"):
        dataclasses.replace(go2_model.PUBLISHED, armature_scale=-1.0)


def test_a_hung_robot_has_no_free_joint_and_hangs_still() -> None:
    spec = go2_model.spec(go2_model.PUBLISHED, 0.002)
    legged_model.hang(spec)
    hung = spec.compile()
    assert hung.nv == hung.nu == 12
    np.testing.assert_allclose(hung.key(legged_model.STAND).qpos, go2_model.DEFAULT)
    data = mujoco.MjData(hung)
    mujoco.mj_step(hung, data, 200)
    np.testing.assert_array_equal(data.body("base").xpos, (0.0, 0.0, 1.0))
