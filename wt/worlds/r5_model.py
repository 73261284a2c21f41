"""The ARX R5 arm as an MJCF of primitives, built from published figures.

Masses, centres of mass, link frames and joint limits are those of the maker's R5a description;
principal inertias, armature, friction and gains are those of the sister arm L5 (same masses) as
published in MuJoCo Menagerie. The fingers are fixed half open and belong to the body
``gripper``, whose centre of mass is where external forces act. The limit of joint 1 is taken
symmetric: the published upper value 2.168 rad contradicts the mirrored lower one (−2.618 rad).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from wt.errors import ConfigError

JOINTS = ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")
GRIPPER = "gripper"
EFFORT = 100.0  # N·m, published for every joint

_FLIP = (0.0, 1.0, 0.0, 0.0)  # half a turn about x, wxyz


@dataclass(frozen=True)
class _R5Link:
    """One moving link: frame in its parent [m, wxyz], joint, inertial [kg, m, kg·m²]."""

    frame: tuple[float, float, float]
    quat: tuple[float, float, float, float]
    axis: tuple[float, float, float]
    limit: tuple[float, float]
    mass: float
    com: tuple[float, float, float]
    inertia_quat: tuple[float, float, float, float]
    inertia: tuple[float, float, float]


_UNIT = (1.0, 0.0, 0.0, 0.0)
_LINKS = (
    _R5Link((0.0, 0.0, 0.0565), _UNIT, (0.0, 0.0, 1.0), (-2.618, 2.618), 0.096804,
          (0.0050395, -0.0077407, 0.020897), (0.632157, 0.714526, -0.263733, 0.142391),
          (0.000118945, 9.40205e-05, 4.70346e-05)),
    _R5Link((0.02, 0.0, 0.047), _UNIT, (0.0, 1.0, 0.0), (0.0, 3.66), 1.1988,
          (-0.12992, -0.0011822, -2.6366e-05), (0.501263, 0.501263, 0.498734, 0.498734),
          (0.0164704, 0.01646, 0.000649595)),
    _R5Link((-0.264, 0.0, 0.0), _FLIP, (0.0, 1.0, 0.0), (0.0, 3.14), 0.84082,
          (0.16181, 0.0011723, -0.05455), (0.518857, 0.484372, 0.465704, 0.52848),
          (0.0084909, 0.00841207, 0.000747034)),
    _R5Link((0.245, -5e-05, -0.06), _UNIT, (0.0, 1.0, 0.0), (-1.57, 1.57), 0.12432,
          (0.041751, 0.0054236, -0.03337), (0.919386, -0.0641253, 0.311071, -0.23206),
          (0.000303193, 0.000235316, 0.000101491)),
    _R5Link((0.0702, 5e-05, -0.083391), _UNIT, (0.0, 0.0, 1.0), (-1.57, 1.57), 0.63601,
          (-8.3435e-05, -1.5428e-05, 0.052216), (0.998247, 0.0, -0.0591776, 0.0),
          (0.000848329, 0.00082, 0.000251671)),
    _R5Link((0.025286, 0.0, 0.083391), _FLIP, (1.0, 0.0, 0.0), (-1.57, 1.57), 0.44089,
          (0.041697, 2.4368e-05, 0.00014464), (0.5, 0.5, -0.5, 0.5),
          (0.0005, 0.00038, 0.00028)),
)  # fmt: skip

_BASE_MASS = 0.42272
_GRIPPER_OFFSET = (0.08657, 0.0, 0.0)
_FINGER_MASS = 0.064798
_FINGER_OPENING = 0.022  # m, half of the published travel
_FINGER_SIZE = (0.03, 0.004, 0.012)  # m, half sizes of the drawing

# Drawing of each link: capsules from → to [m, link frame] with a radius [m].
_SHAPES = (
    ((0.0, 0.0, -0.02), (0.01, 0.0, 0.04), 0.035),
    ((0.0, 0.0, 0.0), (-0.264, 0.0, 0.0), 0.030),
    ((0.0, 0.0, 0.0), (0.245, 0.0, -0.06), 0.027),
    ((0.0, 0.0, 0.0), (0.06, 0.0, -0.06), 0.024),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.08), 0.026),
    ((0.0, 0.0, 0.0), (0.07, 0.0, 0.0), 0.028),
)


@dataclass(frozen=True)
class ArmPhysics:
    """The physics that may differ between two R5 arms; six values each, base to wrist.

    Attributes:
        stiffness: position gain [N·m/rad].
        velocity_gain: velocity gain of the servo [N·m·s/rad].
        damping: viscous joint friction [N·m·s/rad].
        frictionloss: dry joint friction [N·m].
        armature: rotor inertia seen at the joint [kg·m²].
        mass_scale: factor on each link's mass and inertia [-].
    """

    stiffness: tuple[float, ...]
    velocity_gain: tuple[float, ...]
    damping: tuple[float, ...]
    frictionloss: tuple[float, ...]
    armature: tuple[float, ...]
    mass_scale: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse what is not one value per joint, negative values, and links without mass."""
        for name, values in vars(self).items():
            needed = "above zero" if name == "mass_scale" else "of zero or more"
            if len(values) != len(JOINTS) or not (
                min(values) > 0 if name == "mass_scale" else min(values) >= 0
            ):
                raise ConfigError(
                    f"{name} of an arm is {tuple(values)}; {len(JOINTS)} values {needed} are needed"
                )


def build(physics: ArmPhysics, timestep: float) -> mujoco.MjModel:
    """Compile an R5 with the given physics.

    Args:
        physics: gains, friction, armature and mass factors.
        timestep: integration step [s].

    Returns:
        A model with six hinges ``joint1…6``, as many position actuators of the same names, and a
        body ``gripper``. Geoms are for drawing only: they carry no mass and touch nothing.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "r5"
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    parent = spec.worldbody.add_body(name="base")
    _inertial(parent, _BASE_MASS, (0.0, 0.0, 0.031672), _UNIT, (0.00019, 0.00019, 0.0002))
    _capsule(parent, (0.0, 0.0, 0.02), (0.0, 0.0, 0.04), 0.045)
    for i, (name, link) in enumerate(zip(JOINTS, _LINKS, strict=True)):
        body = parent.add_body(name=f"link{i + 1}", pos=link.frame, quat=link.quat)
        scale = physics.mass_scale[i]
        inertia = tuple(scale * x for x in link.inertia)
        _inertial(body, scale * link.mass, link.com, link.inertia_quat, inertia)
        joint = body.add_joint(
            name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=link.axis, range=link.limit
        )
        joint.damping[0] = physics.damping[i]
        joint.frictionloss = physics.frictionloss[i]
        joint.armature = physics.armature[i]
        _capsule(body, *_SHAPES[i])
        actuator = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
            forcerange=(-EFFORT, EFFORT),
        )  # fmt: skip
        actuator.set_to_position(kp=physics.stiffness[i], kv=physics.velocity_gain[i])
        parent = body
    _add_gripper(parent, physics.mass_scale[-1])
    return spec.compile()


def _add_gripper(wrist: mujoco.MjsBody, mass_scale: float) -> None:
    gripper = wrist.add_body(name=GRIPPER, pos=_GRIPPER_OFFSET)
    mass = 2 * mass_scale * _FINGER_MASS
    # two fingers as point masses beside the centre, on top of their own small inertia
    spread = mass * _FINGER_OPENING**2
    own = 2 * mass_scale * np.array([3e-05, 2e-05, 3e-05])
    inertia = tuple(own + np.array([spread, 0.0, spread]))
    _inertial(gripper, mass, (0.0, 0.0, 0.0), _UNIT, inertia)
    for side in (-1, 1):
        geom = gripper.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=_FINGER_SIZE, pos=(0, side * _FINGER_OPENING, 0)
        )
        _draw_only(geom)


def _inertial(
    body: mujoco.MjsBody,
    mass: float,
    com: tuple[float, ...],
    quat: tuple[float, ...],
    inertia: tuple[float, ...],
) -> None:
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat, body.inertia = mass, com, quat, inertia


def _capsule(
    body: mujoco.MjsBody, start: tuple[float, ...], end: tuple[float, ...], radius: float
) -> None:
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*start, *end), size=(radius, 0, 0)
    )
    _draw_only(geom)


def _draw_only(geom: mujoco.MjsGeom) -> None:
    geom.contype, geom.conaffinity, geom.mass = 0, 0, 0.0
