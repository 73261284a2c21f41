"""The Unitree G1 (29 joints, rev 1.0) as an MJCF of primitives, built from published figures.

Masses, inertias, frames and joint limits are those on which mjlab and unitree_rl_gym agree
(33.3411 kg); rotor inertia, torque limits, gains, dry friction and the pose :data:`DEFAULT` are
mjlab's. The right side is the left one's reflection but for two figures that are published
otherwise. Soles, shins, pelvis, torso and head touch the ground, nothing touches the robot itself.

A sole is two capsules from heel to toe between the four points at which unitree_rl_gym has spheres:
the edge of a block across the foot meets a line and not a gap. mjlab's seven capsules reach 12 mm
further at the toe and 4 mm at the heel, for many more contacts in every step on flat ground.
"""

from __future__ import annotations

import dataclasses
import math

import mujoco

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

TRUNK = "pelvis"
FEET = ("left_foot", "right_foot")
"""Names of sites in the middle of the soles; what touches are the geoms ``left_foot1`` … ``2``."""
_NATURAL = 2 * math.pi * 10.0  # rad/s, of each drive with its own rotor: mjlab's rule for gains
_DAMPING_RATIO = 2.0

# rotor inertia seen at the joint [kg·m²] and largest torque [N·m] of each drive
_MEDIUM = (0.010178, 88.0)
_LARGE = (0.025102, 139.0)
_SMALL = (0.0036097, 25.0)
_PAIR = (0.0072195, 50.0)  # two small ones through a four-bar linkage
_TINY = (0.00425, 5.0)


def _joint(name: str, axis: str, low: float, high: float, drive: tuple[float, float]) -> Joint:
    return Joint(f"{name}_joint", axis, (low, high), effort=drive[1], armature=drive[0])


_PELVIS = LeggedLink(
    TRUNK, "", (0.0, 0.0, 0.0), UNIT, 3.813, (0.0, 0.0, -0.07605), (1.0, 0.0, -0.000399148, 0.0),
    (0.010549, 0.0093089, 0.0079184), None, trunk=True,
)  # fmt: skip
_TILT = (0.996179, 0.0, -0.0873386, 0.0)  # of hip roll against hip pitch, undone at the knee
_LEFT_LEG = (
    LeggedLink("left_hip_pitch_link", TRUNK, (0.0, 0.064452, -0.1027), UNIT, 1.35,
         (0.002741, 0.047791, -0.02606), (0.954862, 0.293964, 0.0302556, 0.030122),
         (0.00181517, 0.00153422, 0.00116212),
         _joint("left_hip_pitch", "y", -2.5307, 2.8798, _MEDIUM)),
    LeggedLink("left_hip_roll_link", "left_hip_pitch_link", (0.0, 0.052, -0.030465), _TILT, 1.52,
         (0.029812, -0.001045, -0.087934), (0.977808, -1.97119e-05, 0.205576, -0.0403793),
         (0.00254986, 0.00241169, 0.00148755),
         _joint("left_hip_roll", "x", -0.5236, 2.9671, _LARGE)),
    LeggedLink("left_hip_yaw_link", "left_hip_roll_link", (0.025001, 0.0, -0.12412), UNIT, 1.702,
         (-0.057709, -0.010981, -0.15078), (0.600598, 0.15832, 0.223482, 0.751181),
         (0.00776166, 0.00717575, 0.00160139),
         _joint("left_hip_yaw", "z", -2.7576, 2.7576, _MEDIUM)),
    LeggedLink("left_knee_link", "left_hip_yaw_link", (-0.078273, 0.0021489, -0.17734),
         (0.996179, 0.0, 0.0873386, 0.0), 1.932,
         (0.005457, 0.003964, -0.12074), (0.923418, -0.0327699, 0.0158246, 0.382067),
         (0.0113804, 0.0112778, 0.00146458),
         _joint("left_knee", "y", -0.087267, 2.8798, _LARGE)),
    LeggedLink("left_ankle_pitch_link", "left_knee_link", (0.0, -9.4445e-05, -0.30001), UNIT, 0.074,
         (-0.007269, 0.0, 0.011137), (0.603053, 0.369225, 0.369225, 0.603053),
         (1.89e-05, 1.40805e-05, 6.9195e-06),
         _joint("left_ankle_pitch", "y", -0.87267, 0.5236, _PAIR)),
    LeggedLink("left_ankle_roll_link", "left_ankle_pitch_link", (0.0, 0.0, -0.017558), UNIT, 0.608,
         (0.026505, 0.0, -0.016425), (-0.000481092, 0.728482, -0.000618967, 0.685065),
         (0.00167218, 0.0016161, 0.000217621),
         _joint("left_ankle_roll", "x", -0.2618, 0.2618, _PAIR)),
)  # fmt: skip
_WAIST = (
    LeggedLink("waist_yaw_link", TRUNK, (0.0, 0.0, 0.0), UNIT, 0.214,
         (0.003494, 0.000233, 0.018034), (0.289697, 0.591001, -0.337795, 0.672821),
         (0.000163531, 0.000107714, 0.000102205),
         _joint("waist_yaw", "z", -2.618, 2.618, _MEDIUM), trunk=True),
    LeggedLink("waist_roll_link", "waist_yaw_link", (-0.0039635, 0.0, 0.044), UNIT, 0.086,
         (0.0, 2.3e-05, 0.0), (0.5, 0.5, -0.5, 0.5),
         (8.245e-06, 7.079e-06, 6.339e-06),
         _joint("waist_roll", "x", -0.52, 0.52, _PAIR), trunk=True),
    LeggedLink("torso_link", "waist_roll_link", (0.0, 0.0, 0.0), UNIT, 7.818,
         (0.00203158, 0.000339683, 0.184568),
         (0.999803, -6.03319e-05, 0.0198256, 0.00131986),
         (0.121847, 0.109825, 0.0273735),
         _joint("waist_pitch", "y", -0.52, 0.52, _PAIR), trunk=True),
)  # fmt: skip
_LEFT_ARM = (
    LeggedLink("left_shoulder_pitch_link", "torso_link", (0.0039563, 0.10022, 0.24778),
         (0.990264, 0.139201, 1.38722e-05, -9.86868e-05), 0.718,
         (0.0, 0.035892, -0.011628), (0.654152, 0.0130458, -0.326267, 0.68225),
         (0.000465864, 0.000432842, 0.000406394),
         _joint("left_shoulder_pitch", "y", -3.0892, 2.6704, _SMALL)),
    LeggedLink("left_shoulder_roll_link", "left_shoulder_pitch_link", (0.0, 0.038, -0.013831),
         (0.990268, -0.139172, 0.0, 0.0), 0.643,
         (-0.000227, 0.00727, -0.063243), (0.701256, -0.0196223, -0.00710317, 0.712604),
         (0.000691311, 0.000618011, 0.000388977),
         _joint("left_shoulder_roll", "x", -1.5882, 2.2515, _SMALL)),
    LeggedLink("left_shoulder_yaw_link", "left_shoulder_roll_link", (0.0, 0.00624, -0.1032), UNIT,
         0.734, (0.010773, -0.002949, -0.072009),
         (0.716879, -0.0964829, -0.0679942, 0.687134),
         (0.00106187, 0.00103217, 0.000400661),
         _joint("left_shoulder_yaw", "z", -2.618, 2.618, _SMALL)),
    LeggedLink("left_elbow_link", "left_shoulder_yaw_link", (0.015783, 0.0, -0.080518), UNIT, 0.6,
         (0.064956, 0.004454, -0.010062), (0.541765, 0.636132, 0.388821, 0.388129),
         (0.000443035, 0.000421612, 0.000259353),
         _joint("left_elbow", "y", -1.0472, 2.0944, _SMALL)),
    LeggedLink("left_wrist_roll_link", "left_elbow_link", (0.1, 0.00188791, -0.01), UNIT, 0.085445,
         (0.0171394, 0.000537591, 4.8864e-07), (0.575338, 0.411667, -0.574906, 0.411094),
         (5.48211e-05, 4.96646e-05, 3.57798e-05),
         _joint("left_wrist_roll", "x", -1.97222, 1.97222, _SMALL)),
    LeggedLink("left_wrist_pitch_link", "left_wrist_roll_link", (0.038, 0.0, 0.0), UNIT, 0.48405,
         (0.0229999, -0.00111685, -0.00111658), (0.249998, 0.661363, 0.293036, 0.643608),
         (0.000430353, 0.000429873, 0.000164648),
         _joint("left_wrist_pitch", "y", -1.61443, 1.61443, _TINY)),
    LeggedLink("left_wrist_yaw_link", "left_wrist_pitch_link", (0.046, 0.0, 0.0), UNIT, 0.254576,
         (0.0708244, 0.000191745, 0.00161742), (0.510571, 0.526295, 0.468078, 0.493188),
         (0.000646113, 0.000559993, 0.000147566),
         _joint("left_wrist_yaw", "z", -1.61443, 1.61443, _TINY)),
)  # fmt: skip


def _right(left: LeggedLink) -> LeggedLink:
    """The right side's link, with the two figures that are published otherwise."""
    link = legged_model.mirrored(left, ("left", "right"))
    if link.name == "right_knee_link":
        return dataclasses.replace(
            link, inertia_quat=(0.923439, 0.0345276, 0.0116333, -0.382012),
            inertia=(0.011374, 0.0112843, 0.00146452),
        )  # fmt: skip
    if link.name == "right_shoulder_pitch_link":
        return dataclasses.replace(link, frame=(0.0039563, -0.10021, 0.24778))
    return link


_LINKS = (
    _PELVIS, *_LEFT_LEG, *map(_right, _LEFT_LEG),
    *_WAIST, *_LEFT_ARM, *map(_right, _LEFT_ARM),
)  # fmt: skip
_DRIVEN = tuple(link.joint for link in _LINKS if link.joint is not None)
JOINTS = tuple(joint.name for joint in _DRIVEN)

_BENT = {
    "hip_pitch_joint": -0.312, "knee_joint": 0.669, "ankle_pitch_joint": -0.363,
    "shoulder_pitch_joint": 0.2, "left_shoulder_roll_joint": 0.2,
    "right_shoulder_roll_joint": -0.2, "elbow_joint": 0.6,
}  # fmt: skip
DEFAULT = legged_model.frozen(
    [sum((a for end, a in _BENT.items() if name.endswith(end)), 0.0) for name in JOINTS]
)
"""Standing pose with bent knees, (29,) [rad]: mjlab's keyframe of that name."""
HEIGHT = 0.757  # m, of the pelvis with the soles on the floor in that pose

PUBLISHED = LeggedPhysics(
    stiffness=tuple(joint.armature * _NATURAL**2 for joint in _DRIVEN),
    velocity_gain=tuple(2 * _DAMPING_RATIO * joint.armature * _NATURAL for joint in _DRIVEN),
    damping=(0.0,),
    frictionloss=(0.1,),
)

# Capsules: body (the left one's for both), ends [m], radius [m], colour, whether it touches.
_Shape = tuple[str, Triple, Triple, float, Color, bool]
_MIDDLE: tuple[_Shape, ...] = (
    (TRUNK, (0.0, -0.05, -0.10), (0.0, 0.05, -0.10), 0.065, DARK, True),
    ("waist_yaw_link", (0.0, 0.0, -0.02), (0.0, 0.0, 0.04), 0.055, DARK, False),
    ("torso_link", (0.01, 0.0, 0.08), (0.01, 0.0, 0.20), 0.09, LIGHT, True),
    ("torso_link", (0.005, -0.06, 0.235), (0.005, 0.06, 0.235), 0.06, LIGHT, False),
    ("torso_link", (0.0, 0.0, 0.30), (0.0, 0.0, 0.36), 0.03, DARK, False),
    ("torso_link", (0.0, 0.0, 0.41), (0.0, 0.0, 0.45), 0.06, DARK, True),
)
_LEFT: tuple[_Shape, ...] = (
    ("left_hip_pitch_link", (0.0, 0.01, -0.01), (0.0, 0.052, -0.03), 0.05, DARK, False),
    ("left_hip_roll_link", (0.02, 0.0, 0.0), (0.02, 0.0, -0.08), 0.06, LIGHT, False),
    ("left_hip_yaw_link", (0.0, 0.0, -0.03), (-0.06, 0.0, -0.17), 0.055, LIGHT, False),
    ("left_knee_link", (0.01, 0.0, 0.0), (0.01, 0.0, -0.15), 0.045, LIGHT, True),
    ("left_knee_link", (0.01, 0.0, -0.15), (0.0, 0.0, -0.29), 0.03, LIGHT, False),
    ("left_ankle_roll_link", (-0.03, 0.0, -0.012), (0.10, 0.0, -0.018), 0.016, DARK, False),
    ("left_shoulder_pitch_link", (0.0, 0.0, 0.0), (0.0, 0.045, -0.012), 0.04, DARK, False),
    ("left_shoulder_roll_link", (0.0, 0.0, 0.0), (0.0, 0.006, -0.08), 0.036, LIGHT, False),
    ("left_shoulder_yaw_link", (0.0, 0.0, -0.08), (0.0, 0.0, 0.02), 0.035, LIGHT, False),
    ("left_elbow_link", (-0.01, 0.0, -0.01), (0.08, 0.0, -0.01), 0.033, LIGHT, False),
    ("left_wrist_pitch_link", (-0.01, 0.0, 0.0), (0.06, 0.0, 0.0), 0.03, LIGHT, False),
    ("left_wrist_yaw_link", (0.03, 0.0, 0.0), (0.13, -0.015, 0.0), 0.03, DARK, False),
)
_HEEL, _TOE = (-0.05, 0.025, -0.025), (0.12, 0.03, -0.025)  # m, of the left capsule's ends
_SOLE_RADIUS = 0.01


def build(physics: LeggedPhysics, timestep: float, floor: bool = True) -> mujoco.MjModel:
    """Compile the :func:`spec`; its arguments."""
    return spec(physics, timestep, floor).compile()


def spec(physics: LeggedPhysics, timestep: float, floor: bool = True) -> mujoco.MjSpec:
    """A G1 with the given physics.

    Args:
        physics: gains, friction and mass factors; 29 joints in the order of :data:`JOINTS`. The
            trunk is everything between hips and shoulders: pelvis, waist and torso with head.
        timestep: integration step [s].
        floor: whether there is a floor at height zero.

    Returns:
        A description with the free joint ``base``, the hinges :data:`JOINTS` with position
        actuators of the same names; sites :data:`FEET`; sensors ``gyro`` and ``orientation`` of
        the pelvis; a keyframe ``stand``.
    """
    g1 = legged_model.start("g1", timestep, floor)
    # 35 degrees of freedom on a tree of five branches: 10 % faster than dense
    g1.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    bodies = legged_model.add_robot(g1, _LINKS, physics, HEIGHT)
    for name, start, end, radius, color, touches in _MIDDLE:
        geom = legged_model.add_capsule(bodies[name], (start, end), radius, color)
        if touches:
            legged_model.touches_ground(geom, physics.floor_friction)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for name, start, end, radius, color, touches in _LEFT:
            ends = tuple((x, sign * y, z) for x, y, z in (start, end))
            body = bodies[name.replace("left", side)]
            geom = legged_model.add_capsule(body, (ends[0], ends[1]), radius, color)
            if touches:
                legged_model.touches_ground(geom, physics.floor_friction)
        _add_sole(bodies[f"{side}_ankle_roll_link"], f"{side}_foot", physics.floor_friction)
    legged_model.add_imu(g1, bodies[TRUNK], (0.04525, 0.0, -0.08339))
    pose = (0.0, 0.0, HEIGHT, *UNIT, *DEFAULT.tolist())
    g1.add_key(name=legged_model.STAND, qpos=pose, ctrl=DEFAULT)
    return g1


def _add_sole(ankle: mujoco.MjsBody, foot: str, friction: float) -> None:
    for i, sign in enumerate((1.0, -1.0)):
        heel, toe = ((x, sign * y, z) for x, y, z in (_HEEL, _TOE))
        geom = legged_model.add_capsule(ankle, (heel, toe), _SOLE_RADIUS, DARK)
        geom.name = f"{foot}{i + 1}"
        legged_model.touches_ground(geom, friction)
    middle = ((_HEEL[0] + _TOE[0]) / 2, 0.0, _HEEL[2] - _SOLE_RADIUS)
    ankle.add_site(name=foot, pos=middle, group=3)
