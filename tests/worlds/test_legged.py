"""A herd observes what an independent simulation of each robot says."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.errors import ConfigError
from wt.worlds.legged import FLAT, RATE_HZ, TIMESTEP, Herd, LeggedRobot, LeggedScene, Start
from wt.worlds.legged_model import GYRO
from wt.worlds.robots import G1, GO2, ROBOTS, robot_of
from wt.worlds.terrain import Blocks

each_robot = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)


def make_herd(robot: LeggedRobot, size: int = 3, scene: LeggedScene = FLAT) -> Herd:
    model = robot.describe(robot.physics, TIMESTEP, scene).compile()
    return Herd(robot, model, size, scene, threads=1)


def tumbling(robot: LeggedRobot) -> Herd:
    """Robots in the air that turn and move in all directions."""
    herd = make_herd(robot)
    rng = np.random.default_rng(0)
    herd.reset(np.arange(3), rng, Start(joints=0.2, speed=1.0))
    herd.qpos[:, 2] += 1.0
    quat = rng.normal(size=(3, 4))
    herd.qpos[:, 3:7] = quat / np.linalg.norm(quat, axis=1, keepdims=True)
    herd.qvel[:] = rng.normal(size=herd.qvel.shape)
    herd.step(rng.normal(size=(3, len(robot.joints))))
    return herd


def forwarded(herd: Herd, i: int) -> mujoco.MjData:
    """Robot i in a simulation of its own."""
    data = mujoco.MjData(herd.model)
    data.qpos, data.qvel = herd.qpos[i], herd.qvel[i]
    mujoco.mj_forward(herd.model, data)
    return data


@each_robot
def test_observation_is_what_one_simulation_says(robot: LeggedRobot) -> None:
    herd = tumbling(robot)
    observed = herd.observe()
    channels = [channel.name for channel in robot.channels()]
    assert observed.shape == (3, len(channels)) and observed.dtype == np.float32
    for i in range(3):
        data = forwarded(herd, i)
        rotation = data.body(robot.trunk).xmat.reshape(3, 3)
        down = rotation.T @ (0.0, 0.0, -1.0)
        expected = {
            **dict(zip(("gyro/x", "gyro/y", "gyro/z"), data.sensor(GYRO).data, strict=True)),
            **dict(zip(("gravity/x", "gravity/y", "gravity/z"), down, strict=True)),
            **{f"qpos/{joint}": data.joint(joint).qpos[0] for joint in robot.joints},
            **{f"qvel/{joint}": data.joint(joint).qvel[0] for joint in robot.joints},
            **{f"last_action/{j}": a for j, a in zip(robot.joints, herd.action[i], strict=True)},
        }
        assert list(expected) == channels
        np.testing.assert_allclose(observed[i], list(expected.values()), atol=1e-5)


@each_robot
def test_velocity_is_the_trunk_s_in_its_heading(robot: LeggedRobot) -> None:
    herd = tumbling(robot)
    velocity = herd.velocity()
    for i in range(3):
        data = forwarded(herd, i)
        ahead = data.body(robot.trunk).xmat.reshape(3, 3)[:, 0] * (1, 1, 0)
        ahead /= np.linalg.norm(ahead)
        aside = np.cross((0, 0, 1), ahead)
        twist = np.zeros(6)
        trunk = herd.model.body(robot.trunk).id
        mujoco.mj_objectVelocity(herd.model, data, mujoco.mjtObj.mjOBJ_XBODY, trunk, twist, 0)
        turning, moving = twist[:3], twist[3:]
        expected = [moving @ ahead, moving @ aside, turning[2], moving[2]]
        np.testing.assert_allclose(velocity[i], expected, atol=1e-9)


@each_robot
def test_an_action_asks_for_the_default_pose_and_its_share_of_the_scale(robot: LeggedRobot) -> None:
    herd = make_herd(robot, 1)
    action = np.linspace(-1, 1, len(robot.joints))
    data = forwarded(herd, 0)
    herd.step(action[None])
    for joint, pose, scale, a in zip(
        robot.joints, robot.default, robot.action_scale, action, strict=True
    ):
        data.actuator(joint).ctrl = pose + scale * a
    for _ in range(round(1 / (RATE_HZ * TIMESTEP))):
        mujoco.mj_step(herd.model, data)
    np.testing.assert_allclose(herd.qpos[0], data.qpos, atol=1e-6)


@each_robot
def test_robots_stand_in_the_keyframe_s_pose(robot: LeggedRobot) -> None:
    herd = make_herd(robot)
    np.testing.assert_allclose(herd.joint_pos, np.tile(robot.default, (3, 1)))
    np.testing.assert_allclose(herd.height(), robot.height)
    assert not herd.fallen().any()


def test_reset_touches_only_those_named() -> None:
    herd = make_herd(GO2)
    for _ in range(5):
        herd.step(np.ones((3, 12)))
    before = herd.qpos.copy()
    herd.reset(np.array([1]), np.random.default_rng(0), Start(joints=0.1))
    np.testing.assert_array_equal(herd.qpos[[0, 2]], before[[0, 2]])
    assert np.abs(herd.joint_pos[1] - GO2.default).max() <= 0.1
    np.testing.assert_array_equal(herd.action[:, 0], [1, 0, 1])
    assert not herd.qvel[1].any()


def test_fallen_is_tilted_or_low() -> None:
    herd = make_herd(GO2, 4)
    herd.qpos[1, 3:7] = (np.cos(0.6), np.sin(0.6), 0, 0)  # rolled by 1.2 rad
    herd.qpos[2, 2] = 0.1
    herd.qpos[3, 3:7] = (np.cos(0.4), 0, 0, np.sin(0.4))  # turned, which is no tilt
    np.testing.assert_array_equal(herd.fallen(), [False, True, True, False])


def test_on_blocks_height_counts_from_the_ground_and_nobody_starts_inside_one() -> None:
    scene = LeggedScene(blocks=Blocks(extent=2.0, height=0.3))
    herd = make_herd(G1, 20, scene)
    herd.reset(np.arange(20), np.random.default_rng(0), Start(area=1.8))
    herd.batch.forward()
    for i in range(20):
        data = forwarded(herd, i)
        assert data.ncon == 0 or data.contact.dist.min() > -1e-3
    under = herd.qpos[:, 2] - herd.height()
    assert 0 < under.max() <= 0.3


def test_a_step_that_does_not_divide_the_control_step_is_refused() -> None:
    model = GO2.describe(GO2.physics, 0.003, FLAT).compile()
    with pytest.raises(ConfigError, match=r"0\.003 s does not divide"):
        Herd(GO2, model, 1)


def test_an_unknown_robot_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"'go3' is not known: did you mean 'go2'"):
        robot_of("go3")
