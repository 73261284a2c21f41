"""The Unitree Go2 as an MJCF of primitives, built from published figures, and what it carries.

Masses, inertias, frames, joint limits, torque limits and rotor inertia are those on which MuJoCo
Menagerie and the maker's unitree_mujoco agree; foot friction and impedance and the gains of
:data:`PUBLISHED` are those of unitree_rl_mjlab, joint friction is that of unitree_mujoco. Feet,
knees and the trunk's box touch the ground, nothing touches the robot itself.

A :class:`BallPayload` is a box on the back with a ball that rolls in it. The ball is a free body of
the world whose joint comes last: the addresses of the robot's own joints do not depend on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from wt.errors import ConfigError
from wt.worlds import legged_model
from wt.worlds.legged_model import (
    DARK,
    LIGHT,
    UNIT,
    Color,
    Joint,
    LeggedLink,
    LeggedPhysics,
    Triple,
)

LEGS = ("FL", "FR", "RL", "RR")
JOINTS = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in ("hip", "thigh", "calf"))
FEET = tuple(f"{leg}_foot" for leg in LEGS)
"""Names of the feet: of the sphere that touches the ground, and of a site at its centre."""
TRUNK = "base"
DEFAULT = legged_model.frozen((0.0, 0.9, -1.8) * 4)
"""Standing pose, (12,) [rad]: the published keyframe ``home``."""
HEIGHT = 0.2883  # m, of the trunk's origin with the feet on the floor in that pose

PUBLISHED = LeggedPhysics(
    stiffness=(50.0,),
    velocity_gain=(3.5,),
    damping=(0.1,),
    frictionloss=(0.2,),
)

_HIP_AT = (0.1934, 0.0465)  # m, x and y of the hips, and of their sides
_THIGH_AT = 0.0955  # m, of the thigh beside the hip
_LENGTH = 0.213  # m, of thigh and calf
_FOOT_AT = (-0.002, 0.0, -0.213)
_FOOT_RADIUS = 0.022
_KNEE_RADIUS = 0.02
_TRUNK_SIZE = (0.1881, 0.04675, 0.057)  # m, half sizes
_ARMATURE = 0.01
_HIP_EFFORT, _KNEE_EFFORT = 23.7, 45.43

_BOX: Color = (0.34, 0.71, 0.91, 0.35)
_BALL: Color = (0.84, 0.37, 0.0, 1.0)
BALL = "ball"  # body, free joint and geom
BOX = "box"  # body on the trunk
_PAYLOAD_BIT = 2  # of the box's walls, to which nothing but the ball listens
_WALL = 0.01  # m, as drawn
_PLATE = 0.05  # m, half of what the ball feels


@dataclass(frozen=True)
class BallPayload:
    """A box on the back and a ball that rolls in it.

    Attributes:
        ball_mass: [kg].
        ball_radius: [m]; the default is that of 5 kg of steel.
        length: inner size of the box along the robot [m].
        width: … and across [m].
        height: … and of its walls [m].
        box_mass: [kg].
        lid: whether the box is closed; out of an open one a ball can jump.
    """

    ball_mass: float = 5.0
    ball_radius: float = 0.0534
    length: float = 0.30
    width: float = 0.20
    height: float = 0.12
    box_mass: float = 0.8
    lid: bool = True

    def __post_init__(self) -> None:
        """Refuse nothing to carry and a ball that has no room."""
        for name in ("ball_mass", "ball_radius", "length", "width", "height", "box_mass"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ConfigError(f"payload {name} is {value}; a number above zero is needed")
        sides = {"length": self.length, "width": self.width}
        if self.lid:
            sides["height"] = self.height
        for name, size in sides.items():
            if size <= 2 * self.ball_radius:
                raise ConfigError(
                    f"payload {name} is {size} m, in which a ball of {2 * self.ball_radius} m "
                    f"across cannot roll; make the box larger or ball_radius smaller"
                )

    @property
    def floor_height(self) -> float:
        """Height of the box's inner floor above the trunk's origin [m]."""
        return _TRUNK_SIZE[2] + _WALL

    @property
    def ball_rest(self) -> Triple:
        """The ball's place at rest in the middle of the box, in the trunk's frame [m]."""
        return (0.0, 0.0, self.floor_height + self.ball_radius)


def build(
    physics: LeggedPhysics, timestep: float, payload: BallPayload | None = None, floor: bool = True
) -> mujoco.MjModel:
    """Compile the :func:`spec`; its arguments."""
    return spec(physics, timestep, payload, floor).compile()


def spec(
    physics: LeggedPhysics, timestep: float, payload: BallPayload | None = None, floor: bool = True
) -> mujoco.MjSpec:
    """A Go2 with the given physics.

    Args:
        physics: gains, friction and mass factors; 12 joints in the order of :data:`JOINTS`.
        timestep: integration step [s].
        payload: what it carries; None for nothing.
        floor: whether there is a floor at height zero.

    Returns:
        A description with the free joint ``base``, the hinges :data:`JOINTS` with position
        actuators of the same names, then the ball's free joint ``ball`` if there is one; sites and
        geoms :data:`FEET`; sensors ``gyro`` and ``orientation``; a keyframe ``stand``.
    """
    go2 = legged_model.start("go2", timestep, floor)
    bodies = legged_model.add_robot(go2, _links(), physics, HEIGHT)
    _add_trunk_shapes(bodies[TRUNK], physics.floor_friction)
    for i, leg in enumerate(LEGS):
        _add_leg_shapes(bodies, leg, 1 if i % 2 == 0 else -1, physics.floor_friction)
    legged_model.add_imu(go2, bodies[TRUNK], (-0.02557, 0.0, 0.04232))
    pose = (0.0, 0.0, HEIGHT, *UNIT, *DEFAULT.tolist())
    if payload is not None:
        _add_box(bodies[TRUNK], payload)
        x, y, z = payload.ball_rest
        at = (x, y, z + HEIGHT)
        _add_ball(go2, payload, at)
        pose = (*pose, *at, *UNIT)
    go2.add_key(name=legged_model.STAND, qpos=pose, ctrl=DEFAULT)
    return go2


def _links() -> list[LeggedLink]:
    """The 13 links in the order of the joints; right legs are the left ones' reflections."""
    links = [
        LeggedLink(TRUNK, "", (0.0, 0.0, 0.0), UNIT, 6.921, (0.021112, 0.0, -0.005366),
             (-0.000543471, 0.713435, -0.00173769, 0.700719),
             (0.107027, 0.0980771, 0.0244531), None, trunk=True),
    ]  # fmt: skip
    front_hip, rear_hip = (
        (0.497014, 0.499245, 0.505462, 0.498237),
        (0.505462, 0.498237, 0.497014, 0.499245),
    )
    for left, right, sign, hip_inertia, thigh_limits in (
        ("FL", "FR", 1, front_hip, (-1.5708, 3.4907)),
        ("RL", "RR", -1, rear_hip, (-0.5236, 4.5379)),
    ):
        leg = [
            LeggedLink(f"{left}_hip", TRUNK, (sign * _HIP_AT[0], _HIP_AT[1], 0.0), UNIT,
                 0.678, (-0.0054 * sign, 0.00194, -0.000105), hip_inertia,
                 (0.00088403, 0.000596003, 0.000479967),
                 Joint(f"{left}_hip_joint", "x", (-1.0472, 1.0472), _HIP_EFFORT, _ARMATURE)),
            LeggedLink(f"{left}_thigh", f"{left}_hip", (0.0, _THIGH_AT, 0.0), UNIT,
                 1.152, (-0.00374, -0.0223, -0.0327),
                 (0.829533, 0.0847635, -0.0200632, 0.551623),
                 (0.00594973, 0.00584149, 0.000878787),
                 Joint(f"{left}_thigh_joint", "y", thigh_limits, _HIP_EFFORT, _ARMATURE)),
            LeggedLink(f"{left}_calf", f"{left}_thigh", (0.0, 0.0, -_LENGTH), UNIT,
                 0.241352, (0.00629595, -0.000622121, -0.141417),
                 (0.710672, 0.00154099, -0.00450087, 0.703508),
                 (0.0014901, 0.00146356, 5.31397e-05),
                 Joint(f"{left}_calf_joint", "y", (-2.7227, -0.83776), _KNEE_EFFORT, _ARMATURE)),
        ]  # fmt: skip
        links += leg
        links += [legged_model.mirrored(link, (left, right)) for link in leg]
    return links


def _add_trunk_shapes(trunk: mujoco.MjsBody, friction: float) -> None:
    box, sphere = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
    solid = legged_model.add_solid(trunk, box, (0.0, 0.0, 0.0), _TRUNK_SIZE, LIGHT)
    legged_model.touches_ground(solid, friction)
    legged_model.add_solid(trunk, box, (0.0, 0.0, 0.005), (0.13, 0.085, 0.045), LIGHT)
    for x in (-_HIP_AT[0], _HIP_AT[0]):
        ends = ((x, -_HIP_AT[1], 0.0), (x, _HIP_AT[1], 0.0))
        legged_model.add_capsule(trunk, ends, 0.046, DARK)
    legged_model.add_capsule(trunk, ((0.26, 0.0, 0.01), (0.295, 0.0, 0.01)), 0.05, LIGHT)
    legged_model.add_solid(trunk, sphere, (0.293, 0.0, -0.06), (0.04,), DARK)


def _add_leg_shapes(
    bodies: dict[str, mujoco.MjsBody], leg: str, side: int, friction: float
) -> None:
    hip, thigh, calf = (bodies[f"{leg}_{part}"] for part in ("hip", "thigh", "calf"))
    ends = ((0.0, side * 0.06, 0.0), (0.0, side * 0.10, 0.0))
    legged_model.add_capsule(hip, ends, 0.042, DARK)
    legged_model.add_capsule(thigh, ((0.0, 0.0, 0.0), (-0.012, 0.0, -0.12)), 0.03, LIGHT)
    legged_model.add_capsule(thigh, ((-0.012, 0.0, -0.12), (0.0, 0.0, -_LENGTH)), 0.02, LIGHT)
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    knee = legged_model.add_solid(calf, sphere, (0.0, 0.0, 0.0), (_KNEE_RADIUS,), DARK)
    legged_model.touches_ground(knee, friction)
    legged_model.add_capsule(calf, ((0.0, 0.0, 0.0), (0.018, 0.0, -0.12)), 0.013, DARK)
    legged_model.add_capsule(calf, ((0.018, 0.0, -0.12), _FOOT_AT), 0.011, DARK)
    foot = legged_model.add_solid(calf, sphere, _FOOT_AT, (_FOOT_RADIUS,), DARK)
    foot.name = f"{leg}_foot"
    legged_model.touches_ground(foot, friction)
    foot.solimp[:3] = (0.9, 0.95, 0.023)
    calf.add_site(name=f"{leg}_foot", pos=_FOOT_AT, group=3)


def _add_box(trunk: mujoco.MjsBody, payload: BallPayload) -> None:
    """A body without joint: six plates as the ball feels them, floor and low rim to look at.

    The plates are far thicker than they look, outward: a ball that hits one hard sinks in, and is
    pushed back as long as its centre has not passed the plate's middle.
    """
    half = (payload.length / 2, payload.width / 2, payload.height / 2)
    body = trunk.add_body(name=BOX, pos=(0.0, 0.0, payload.floor_height))
    body.explicitinertial = True
    body.mass, body.ipos = payload.box_mass, (0.0, 0.0, half[2])
    # as if its mass were spread evenly over the volume: within a factor of two of thin walls
    body.inertia = tuple(
        payload.box_mass / 3 * (half[a] ** 2 + half[b] ** 2) for a, b in ((1, 2), (0, 2), (0, 1))
    )
    for axis in range(3):
        for sign in (-1, 1):
            if axis < 2 or sign < 0 or payload.lid:
                _add_plate(body, half, axis, sign)
            if axis < 2:
                _draw_plate(body, half, axis, sign, half[2] / 4)
    _draw_plate(body, half, 2, -1, half[2])


def _add_plate(body: mujoco.MjsBody, half: Triple, axis: int, sign: int) -> None:
    """One side of the box as the ball feels it, thick and hidden."""
    size = [h + 2 * _PLATE for h in half]
    pos = [0.0, 0.0, half[2]]
    size[axis] = _PLATE
    pos[axis] += sign * (half[axis] + _PLATE)
    plate = legged_model.add_solid(
        body, mujoco.mjtGeom.mjGEOM_BOX, (pos[0], pos[1], pos[2]), tuple(size), _BOX
    )
    plate.contype, plate.group = _PAYLOAD_BIT, 3


def _draw_plate(body: mujoco.MjsBody, half: Triple, axis: int, sign: int, height: float) -> None:
    """One side as it looks, walls only up to a height that hides no ball."""
    size = [half[0] + _WALL, half[1] + _WALL, height]
    pos = [0.0, 0.0, height]
    size[axis] = _WALL / 2
    pos[axis] = sign * (half[axis] + _WALL / 2) if axis < 2 else -_WALL / 2
    legged_model.add_solid(
        body, mujoco.mjtGeom.mjGEOM_BOX, (pos[0], pos[1], pos[2]), tuple(size), _BOX
    )


def _add_ball(spec: mujoco.MjSpec, payload: BallPayload, at: Triple) -> None:
    body = spec.worldbody.add_body(name=BALL, pos=at)
    body.add_freejoint(name=BALL)
    body.explicitinertial = True
    body.mass, body.ipos = payload.ball_mass, (0.0, 0.0, 0.0)
    body.inertia = (2 / 5 * payload.ball_mass * payload.ball_radius**2,) * 3
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    geom = legged_model.add_solid(body, sphere, (0.0, 0.0, 0.0), (payload.ball_radius,), _BALL)
    geom.name = BALL
    geom.conaffinity, geom.priority, geom.condim = _PAYLOAD_BIT, 1, 3
    # steel on hard walls: the stiffest contact that steps of 5 ms resolve
    geom.solref, geom.friction[0] = (0.01, 1.0), 0.4
