"""The SO-101 follower arm as an MJCF of primitives, built from published figures.

Link frames, masses, centres of mass, inertias and joint limits are those of the maker's
description (TheRobotStudio/SO-ARM100, ``so101_new_calib``); damping, friction loss, armature and
effort of the STS3215 servo are those published with it. The position gain is an option: 17.8
N·m/rad is the published value for the firmware gain 32.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco

from wt.worlds import model_file

ARM_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
JAW = "gripper"
JOINTS = (*ARM_JOINTS, JAW)

LIMITS = {
    "shoulder_pan": (-1.91986218, 1.91986218),
    "shoulder_lift": (-1.74532925, 1.74532925),
    "elbow_flex": (-1.69, 1.69),
    "wrist_flex": (-1.65806285, 1.65806273),
    "wrist_roll": (-2.74384730, 2.84120631),
    "gripper": (-0.17453298, 1.74532920),
}
"""Published range of each joint [rad]."""


@dataclass(frozen=True)
class ServoPhysics:
    """The six identical servos.

    Attributes:
        kp: position gain [N·m/rad].
        kv: velocity gain [N·m·s/rad].
        damping: viscous joint friction [N·m·s/rad].
        frictionloss: dry joint friction [N·m].
        armature: rotor inertia seen at the joint [kg·m²].
        torque: largest torque, either way [N·m].
        delay: how late a command arrives [s].
    """

    kp: float = 17.8
    kv: float = 0.0
    damping: float = 0.60
    frictionloss: float = 0.052
    armature: float = 0.028
    torque: float = 2.94
    delay: float = 0.0


@dataclass(frozen=True)
class _SO101Link:
    """One body: frame in its parent [m, wxyz], inertial [kg, m, kg·m²], drawing [m].

    ``inertia`` is (xx, yy, zz, xy, xz, yz) about the centre of mass, in the body's axes;
    ``capsule`` is (from, to, radius) in the body's frame.
    """

    name: str
    frame: tuple[float, float, float]
    quat: tuple[float, float, float, float]
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]
    capsule: tuple[tuple[float, float, float], tuple[float, float, float], float]


_BASE = _SO101Link(
    "base", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.147, (0.0137179, -5.19711e-05, 0.0334843),
    (0.000114686, 0.000136117, 0.000130364, -4.59787e-07, 4.97151e-06, 9.75275e-08),
    ((-0.02, 0.0, 0.02), (0.0388353, 0.0, 0.035), 0.02),
)  # fmt: skip

# In the order of JOINTS: link i turns about its own z axis by joint i.
_LINKS = (
    _SO101Link("shoulder", (0.0388353, 0.0, 0.0624), (0.0, 0.0, -1.0, 0.0), 0.100006,
          (-0.0307604, -1.66727e-05, -0.0252713),
          (8.3759e-05, 8.10403e-05, 2.39783e-05, 7.55525e-08, -1.16342e-06, 1.54663e-07),
          ((0.0, 0.0, 0.0), (-0.0303992, 0.0, -0.0542), 0.022)),
    _SO101Link("upper_arm", (-0.0303992, -0.0182778, -0.0542), (1.0, -1.0, -1.0, -1.0), 0.103,
          (-0.0898471, -0.00838224, 0.0184089),
          (4.08002e-05, 0.000147318, 0.000142487, -1.97819e-05, -4.03016e-08, 8.97326e-09),
          ((0.0, 0.0, 0.018), (-0.11257, -0.028, 0.018), 0.015)),
    _SO101Link("lower_arm", (-0.11257, -0.028, 0.0), (1.0, 0.0, 0.0, 1.0), 0.104,
          (-0.0980701, 0.00324376, 0.0182831),
          (2.87438e-05, 0.000159844, 0.00014529, 7.41152e-06, 1.26409e-06, -4.90188e-08),
          ((0.0, 0.0, 0.018), (-0.1349, 0.0052, 0.018), 0.014)),
    _SO101Link("wrist", (-0.1349, 0.0052, 0.0), (1.0, 0.0, 0.0, -1.0), 0.079,
          (-0.000103312, -0.0386143, 0.0281156),
          (3.68263e-05, 2.5391e-05, 2.1e-05, 1.7893e-08, -5.28128e-08, 3.6412e-06),
          ((0.0, 0.0, 0.018), (0.0, -0.0611, 0.018), 0.014)),
    _SO101Link("gripper", (0.0, -0.0611, 0.0181),
          (0.0172091, -0.0172091, 0.706897, 0.706897), 0.087,
          (0.000213627, 0.000245138, -0.025187),
          (2.75087e-05, 4.33657e-05, 3.45059e-05, -3.35241e-07, -5.7352e-06, -5.17847e-08),
          ((-0.008, 0.0, -0.02), (-0.0079, -0.000218121, -0.0981274), 0.012)),
    _SO101Link("moving_jaw", (0.0202, 0.0188, -0.0234), (1.0, 1.0, 0.0, 0.0), 0.012,
          (-0.00157495, -0.0300244, 0.0192755),
          (6.61427e-06, 1.89032e-06, 5.28738e-06, -3.19807e-07, -5.90717e-09, -1.09945e-07),
          ((0.0, 0.0, 0.019), (-0.005, -0.07, 0.019), 0.008)),
)  # fmt: skip

TIP = "tip"
_ROUNDING = 1e-6  # of a step: rounded times must not decide which of two commands has come
_TIP_FRAME = (-0.0079, -0.000218121, -0.0981274)


def build(servo: ServoPhysics, timestep: float) -> mujoco.MjModel:
    """Compile an SO-101 with the given servos.

    Args:
        servo: gains, friction and effort, the same for all six joints.
        timestep: integration step [s].

    Returns:
        The compiled :func:`spec`.
    """
    return spec(servo, timestep).compile()


def spec(servo: ServoPhysics, timestep: float) -> mujoco.MjSpec:
    """An SO-101 with the given servos.

    Args:
        servo: gains, friction and effort, the same for all six joints.
        timestep: integration step [s].

    Returns:
        A description with six hinges, as many position actuators of the same names (:data:`JOINTS`)
        and a site ``tip`` between the jaws. Geoms are for drawing only: they carry no mass and
        touch nothing. Zero is the middle of each joint's swept range.
    """
    arm = mujoco.MjSpec()
    arm.modelname = "so101"
    arm.compiler.degree = False
    arm.option.timestep = timestep
    arm.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    parent = _add_body(arm.worldbody, _BASE)
    for name, link in zip(JOINTS, _LINKS, strict=True):
        body = _add_body(parent, link)
        joint = body.add_joint(
            name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1), range=LIMITS[name]
        )
        joint.damping[0] = servo.damping
        joint.frictionloss = servo.frictionloss
        joint.armature = servo.armature
        actuator = arm.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
            forcerange=(-servo.torque, servo.torque), ctrlrange=LIMITS[name],
        )  # fmt: skip
        actuator.set_to_position(kp=servo.kp, kv=servo.kv)
        if servo.delay:
            actuator.nsample = _samples(servo.delay, timestep)
            actuator.delay = servo.delay - _ROUNDING * timestep
        if link.name == "gripper":
            body.add_site(name=TIP, pos=_TIP_FRAME)
        parent = body
    return arm


def load(path: Path | str, timestep: float) -> mujoco.MjModel:
    """Compile an SO-101 from an MJCF, such as a diagnosis writes.

    Names decide: the six hinges and their actuators have to be there, in any order. What else is in
    it is hidden state: a gear's play, a drive's filter.

    Args:
        path: the MJCF, or a diagnosis' folder.
        timestep: integration step, in place of its own [s].

    Raises:
        ModelError: it cannot be read, or is of another robot.
    """

    def stepped(arm: mujoco.MjSpec) -> None:
        for drive in arm.actuators:
            if drive.delay:
                drive.nsample = _samples(drive.delay, timestep)
        arm.option.timestep = timestep

    model = model_file.read(path, stepped)
    kinds = mujoco.mjtObj
    needed = [("joint", kinds.mjOBJ_JOINT, JOINTS), ("actuator", kinds.mjOBJ_ACTUATOR, JOINTS)]
    model_file.refuse(path, "SO-101", model_file.lacking(model, needed))
    return model


def _samples(delay: float, timestep: float) -> int:
    """Commands that a late actuator has to remember."""
    return math.ceil(delay / timestep) + 1


def _add_body(parent: mujoco.MjsBody, link: _SO101Link) -> mujoco.MjsBody:
    body = parent.add_body(name=link.name, pos=link.frame, quat=link.quat)
    body.explicitinertial = True
    body.mass, body.ipos, body.fullinertia = link.mass, link.com, link.inertia
    start, end, radius = link.capsule
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*start, *end), size=(radius, 0, 0)
    )
    geom.contype, geom.conaffinity, geom.mass = 0, 0, 0.0
    return body
