"""Common parts of legged robots' models: the physics that may differ, and building a tree.

A robot is a table of :class:`LeggedLink`, built with MjSpec below a free joint. Only its feet and
the few parts that carry a fallen robot touch anything, and only the ground: every geom of the robot
has ``contype`` 0 and listens to :data:`GROUND`, the bit of the floor and, by MuJoCo's default, of
any terrain put beside it. Friction belongs to the robot's geoms (``priority`` 1), so that a floor
and blocks of terrain feel the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float64

from wt.errors import ConfigError

BASE = "base"  # name of the free joint: qpos[:7] and qvel[:6]
GYRO = "gyro"  # angular velocity of the trunk at its IMU [rad/s], 3 numbers
ORIENTATION = "orientation"  # quaternion of the IMU, wxyz
STAND = "stand"  # keyframe: feet on the floor, joints and targets at the default pose
GROUND = 1  # contype bit of floor and terrain

Triple = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Color = tuple[float, float, float, float]

UNIT: Quat = (1.0, 0.0, 0.0, 0.0)
DARK: Color = (0.18, 0.19, 0.21, 1.0)
LIGHT: Color = (0.67, 0.69, 0.77, 1.0)

_AXES: dict[str, Triple] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class LeggedPhysics:
    """The physics that may differ between two robots of one kind.

    The first four have one value per joint, in the model's order, or a single one for all. Rotor
    inertia is published per joint.

    Attributes:
        stiffness: position gain of the drives [N·m/rad].
        velocity_gain: their velocity gain [N·m·s/rad].
        damping: viscous joint friction [N·m·s/rad].
        frictionloss: dry joint friction [N·m].
        trunk_mass_scale: factor on the trunk's mass and inertia [-].
        limb_mass_scale: the same for everything else [-].
        armature_scale: factor on the published rotor inertias [-].
        floor_friction: sliding friction between robot and ground [-].
    """

    stiffness: tuple[float, ...]
    velocity_gain: tuple[float, ...]
    damping: tuple[float, ...]
    frictionloss: tuple[float, ...]
    trunk_mass_scale: float = 1.0
    limb_mass_scale: float = 1.0
    armature_scale: float = 1.0
    floor_friction: float = 0.6

    def __post_init__(self) -> None:
        """Refuse negative or missing numbers, and links without mass."""
        for name in ("stiffness", "velocity_gain", "damping", "frictionloss"):
            values = getattr(self, name)
            if not values or not all(0 <= x < np.inf for x in values):
                raise ConfigError(
                    f"{name} of a legged robot is {tuple(values)}; one value per joint or a single "
                    "one for all is needed, each of zero or more"
                )
        for name in ("trunk_mass_scale", "limb_mass_scale", "floor_friction"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigError(
                    f"{name} of a legged robot is {getattr(self, name)}; it must be above zero"
                )
        if not 0 <= self.armature_scale < np.inf:
            raise ConfigError(
                f"armature_scale of a legged robot is {self.armature_scale}; zero or more is needed"
            )

    def per_joint(self, name: str, joints: int) -> tuple[float, ...]:
        """The values of one of the first four attributes for a robot with that many joints."""
        values: tuple[float, ...] = tuple(getattr(self, name))
        if len(values) not in (1, joints):
            raise ConfigError(
                f"{name} of a robot with {joints} joints has {len(values)} values; give {joints}, "
                "or a single one for all"
            )
        return values * joints if len(values) == 1 else values


@dataclass(frozen=True)
class Joint:
    """A hinge through the origin of its link.

    Attributes:
        name: of the joint, and of the position actuator that drives it.
        axis: x, y or z of the link.
        limits: range [rad].
        effort: largest torque of the drive, either way [N·m].
        armature: rotor inertia seen at the joint [kg·m²].
    """

    name: str
    axis: str
    limits: tuple[float, float]
    effort: float
    armature: float


@dataclass(frozen=True)
class LeggedLink:
    """One body.

    Attributes:
        name: of the body.
        parent: its parent's name; empty for the one on the free joint.
        frame: origin in the parent [m].
        quat: orientation in the parent, wxyz.
        mass: [kg].
        com: centre of mass in the link [m].
        inertia_quat: orientation of the principal axes in the link, wxyz.
        inertia: about the principal axes [kg·m²].
        joint: to the parent; None for the free joint.
        trunk: whether ``trunk_mass_scale`` holds for it, or ``limb_mass_scale``.
    """

    name: str
    parent: str
    frame: Triple
    quat: Quat
    mass: float
    com: Triple
    inertia_quat: Quat
    inertia: Triple
    joint: Joint | None
    trunk: bool = False


def mirrored(left: LeggedLink, rename: tuple[str, str]) -> LeggedLink:
    """The link's reflection across the robot's plane y = 0.

    Args:
        left: the link.
        rename: what to replace in its name, its parent's and its joint's, and by what.
    """
    joint = left.joint
    if joint is not None:
        low, high = joint.limits
        limits = (low, high) if joint.axis == "y" else (-high, -low)
        joint = replace(joint, name=joint.name.replace(*rename), limits=limits)
    (x, y, z), (cx, cy, cz) = left.frame, left.com
    return replace(
        left, name=left.name.replace(*rename), parent=left.parent.replace(*rename), joint=joint,
        frame=(x, -y, z), quat=_reflected(left.quat),
        com=(cx, -cy, cz), inertia_quat=_reflected(left.inertia_quat),
    )  # fmt: skip


def _reflected(quat: Quat) -> Quat:
    # diag(1, −1, 1) R diag(1, −1, 1); principal inertia stays as it is
    w, x, y, z = quat
    return (w, -x, y, -z)


def start(name: str, timestep: float, floor: bool) -> mujoco.MjSpec:
    """An empty world with the solver's settings and, if wanted, a floor at height zero.

    ``implicitfast`` takes the servos' velocity gains implicitly, at a step of 5 ms. Newton, warm
    started, stops by its tolerance after 1–3 iterations: a cap of 5 saves nothing, one of 1 blows
    up. Pyramidal cones are 40 % faster than elliptic ones on the Go2 and as fast on the G1. All
    that moves is one island, of which the search costs 5 %.

    Args:
        name: of the model.
        timestep: integration step [s]; a ConfigError if it is not above zero.
        floor: whether there is a plane to stand on.
    """
    if not 0 < timestep < np.inf:
        raise ConfigError(f"timestep of {name} is {timestep} s; it must be above zero")
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    spec.worldbody.add_light(pos=(0, 0, 4), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    if floor:
        plane = spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1), rgba=(0.9, 0.9, 0.9, 1)
        )
        plane.contype, plane.conaffinity = GROUND, 0
    return spec


def add_robot(
    spec: mujoco.MjSpec, links: Sequence[LeggedLink], physics: LeggedPhysics, height: float
) -> dict[str, mujoco.MjsBody]:
    """Add a tree of links below a free joint, and a position actuator for each hinge.

    Args:
        spec: what to add to.
        links: parents before children, in the order in which joints are to be numbered.
        physics: gains, friction and mass factors.
        height: of the first link's origin in ``qpos0`` [m].

    Returns:
        The bodies by name.

    Raises:
        ConfigError: ``physics`` has another number of joints.
    """
    n = sum(link.joint is not None for link in links)
    gains, speed_gains, damping, dry = (
        physics.per_joint(name, n)
        for name in ("stiffness", "velocity_gain", "damping", "frictionloss")
    )
    bodies: dict[str, mujoco.MjsBody] = {}
    j = 0
    for link in links:
        parent = bodies[link.parent] if link.parent else spec.worldbody
        body = parent.add_body(name=link.name, pos=link.frame, quat=link.quat)
        bodies[link.name] = body
        scale = physics.trunk_mass_scale if link.trunk else physics.limb_mass_scale
        body.explicitinertial = True
        body.mass, body.inertia = scale * link.mass, tuple(scale * x for x in link.inertia)
        body.ipos, body.iquat = link.com, link.inertia_quat
        if link.joint is None:
            body.add_freejoint(name=BASE)
            body.pos = (0.0, 0.0, height)
            continue
        joint = body.add_joint(
            name=link.joint.name, type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=_AXES[link.joint.axis], range=link.joint.limits,
        )  # fmt: skip
        joint.damping[0], joint.frictionloss = damping[j], dry[j]
        joint.armature = physics.armature_scale * link.joint.armature
        actuator = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
            forcerange=(-link.joint.effort, link.joint.effort),
        )  # fmt: skip
        actuator.set_to_position(kp=gains[j], kv=speed_gains[j])
        j += 1
    return bodies


def hang(spec: mujoco.MjSpec, height: float = 1.0) -> None:
    """Hold a robot's trunk in the air, in place: its free joint goes, also out of its keyframes.

    Args:
        spec: of a robot whose first joint is the free joint :data:`BASE`.
        height: of the trunk's origin [m].
    """
    base = spec.joint(BASE)
    trunk = base.parent
    spec.delete(base)
    for key in spec.keys:
        key.qpos = list(key.qpos)[7:]
    trunk.pos = (0.0, 0.0, height)


def add_capsule(
    body: mujoco.MjsBody, ends: tuple[Triple, Triple], radius: float, color: Color
) -> mujoco.MjsGeom:
    """Add a capsule, for drawing until :func:`touches_ground` says otherwise.

    Args:
        body: what it belongs to.
        ends: centres of its two caps in the body [m].
        radius: [m].
        color: RGBA, 0–1.
    """
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*ends[0], *ends[1]), size=(radius, 0, 0)
    )
    return _draw_only(geom, color)


def add_solid(
    body: mujoco.MjsBody, kind: mujoco.mjtGeom, pos: Triple, size: tuple[float, ...], color: Color
) -> mujoco.MjsGeom:
    """Add a sphere or box, for drawing; size as in MJCF [m], the rest as :func:`add_capsule`."""
    padded = (*size, 0.0, 0.0)[:3]
    return _draw_only(body.add_geom(type=kind, pos=pos, size=padded), color)


def _draw_only(geom: mujoco.MjsGeom, color: Color) -> mujoco.MjsGeom:
    geom.contype, geom.conaffinity, geom.mass = 0, 0, 0.0
    geom.rgba = color
    return geom


def touches_ground(geom: mujoco.MjsGeom, friction: float) -> None:
    """Let a geom collide with floor and terrain, and with nothing else.

    Contacts have three dimensions: a foot's torsional and rolling friction (published as 2 and 1 cm
    beside a sliding one of 0.8) matter little, and twice as many rows would pay for them.
    """
    geom.conaffinity = GROUND
    geom.priority, geom.condim = 1, 3
    geom.friction[0] = friction


def add_imu(spec: mujoco.MjSpec, trunk: mujoco.MjsBody, pos: Triple) -> None:
    """Add a site ``imu`` with its sensors :data:`GYRO` and :data:`ORIENTATION` to the trunk."""
    site = trunk.add_site(name="imu", pos=pos, group=3)
    kinds = ((GYRO, mujoco.mjtSensor.mjSENS_GYRO), (ORIENTATION, mujoco.mjtSensor.mjSENS_FRAMEQUAT))
    for name, kind in kinds:
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name)


def frozen(values: Sequence[float]) -> Float64[np.ndarray, " value"]:
    """A read-only array of floats."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
