"""The legged robots that policies walk: Go2 and G1, with the figures that a policy relies on."""

from __future__ import annotations

import mujoco

from wt.errors import ConfigError, suggest
from wt.worlds import g1_model, go2_model
from wt.worlds.legged import LeggedRobot, LeggedScene
from wt.worlds.legged_model import LeggedPhysics, hang
from wt.worlds.terrain import add_blocks

_SHARE = 0.25  # of a drive's torque limit, which the action 1 asks for: mjlab's rule


def _go2(physics: LeggedPhysics, timestep: float, scene: LeggedScene) -> mujoco.MjSpec:
    spec = go2_model.spec(physics, timestep, scene.payload)
    if scene.blocks is not None:
        add_blocks(spec, scene.blocks)
    return spec


def _g1(physics: LeggedPhysics, timestep: float, scene: LeggedScene) -> mujoco.MjSpec:
    if scene.payload is not None:
        raise ConfigError("scene.payload: the G1 has no box for a ball; take the go2 or none")
    spec = g1_model.spec(physics, timestep)
    if scene.blocks is not None:
        add_blocks(spec, scene.blocks)
    return spec


def _g1_scale() -> tuple[float, ...]:
    model = g1_model.build(g1_model.PUBLISHED, 0.005)
    efforts, gains = model.actuator_forcerange[:, 1], model.actuator_gainprm[:, 0]
    return tuple(round(float(x), 4) for x in _SHARE * efforts / gains)


GO2 = LeggedRobot(
    name="go2",
    joints=go2_model.JOINTS,
    default=tuple(go2_model.DEFAULT.tolist()),
    action_scale=(0.5,) * len(go2_model.JOINTS),
    trunk=go2_model.TRUNK,
    feet=go2_model.FEET,
    sole_bodies=(),
    sole_geoms=go2_model.FEET,
    turns=(0.0, 0.5, 0.5, 0.0),  # a trot: diagonal legs together
    height=go2_model.HEIGHT,
    foot_rest=0.022,
    command=(1.0, 0.5, 1.0),
    fall_tilt=1.05,
    fall_height=0.14,
    physics=go2_model.PUBLISHED,
    describe=_go2,
)
G1 = LeggedRobot(
    name="g1",
    joints=g1_model.JOINTS,
    default=tuple(g1_model.DEFAULT.tolist()),
    action_scale=_g1_scale(),
    trunk=g1_model.TRUNK,
    feet=g1_model.FEET,
    sole_bodies=("left_ankle_roll_link", "right_ankle_roll_link"),
    sole_geoms=(),
    turns=(0.0, 0.5),
    height=g1_model.HEIGHT,
    foot_rest=0.0,
    command=(0.6, 0.3, 0.5),
    fall_tilt=0.9,
    fall_height=0.45,
    physics=g1_model.PUBLISHED,
    describe=_g1,
)
ROBOTS = {robot.name: robot for robot in (GO2, G1)}


def robot_of(name: str) -> LeggedRobot:
    """The robot of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in ROBOTS:
        raise ConfigError(f"robot {name!r} is not known: {suggest(name, ROBOTS)}")
    return ROBOTS[name]


def mjcf(name: str, timestep: float = 0.002, hung: bool = False) -> str:
    """A robot as MJCF, with its published figures, on a flat floor.

    Args:
        name: of the robot.
        timestep: integration step [s].
        hung: whether its trunk is held in the air, without a free joint.

    Raises:
        ConfigError: there is no robot of that name.
    """
    robot = robot_of(name)
    spec = robot.describe(robot.physics, timestep, LeggedScene())
    if hung:
        hang(spec)
    spec.compile()
    return str(spec.to_xml())
