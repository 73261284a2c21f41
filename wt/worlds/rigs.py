"""MJCFs of robots whose recordings ``wt import`` reads, from published figures.

Names are those that the importers write, and angle 0 hangs down. The two servo rigs leave friction
out on purpose: they are what a user has before a diagnosis, rigid bodies and actuators.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from wt.errors import DataError, UserError, suggest
from wt.show.files import write_whole
from wt.worlds import so101_model

GRAVITY = 9.81  # m/s², what both laboratories compute with

# Double pendulum C.1, dfki-ric-underactuated-lab/double_pendulum, model_parameters.yml of model
# 1.0, and its URDF.
_MASS = (0.5234602302310271, 0.6255677234174437)  # kg
_LENGTH = (0.2, 0.3)  # m, pivot to pivot, and to the end
_COM = (0.2, 0.25569305436052964)  # m below the pivot
_INERTIA = (0.031887199591513114, 0.05086984812807257)  # kg·m² about the pivot
_ROTOR = 6.287203962819607e-05  # kg·m², at the motor
_GEAR = 6.0
_TORQUE = 10.0  # N·m
_PENDULUM_JOINTS = ("shoulder", "elbow")

# Servo bench, Rhoban/bam.
_BENCH_MASS, _BENCH_LENGTH = 0.49, 0.100  # kg, m
_COUNTS = 4096.0  # encoder counts per turn
_DUTY_FULL = 885.0  # PWM register at duty 1
_LEAST_INERTIA = 1e-6  # kg·m², a five-thousandth of the bench's
_GAIN_UNIT = 256.0  # firmware gain that gives one PWM step per count of error


@dataclass(frozen=True)
class MotorConstants:
    """Electrical constants of a geared motor, seen at its output.

    The defaults are those of an XL330 from Rhoban/bam, fit m1 (xl330).

    Attributes:
        kt: torque constant [N·m/A], which is also the back-EMF constant [V·s/rad].
        resistance: of the winding [Ohm].
        supply: nominal voltage at duty 1 [V].
    """

    kt: float = 0.3866957639281311
    resistance: float = 4.017129222290597
    supply: float = 7.4


def double_pendulum_spec(rotors: bool = True) -> mujoco.MjSpec:
    """The double pendulum C.1 as rigid bodies with torque motors, without any friction.

    Args:
        rotors: whether the motors' rotors are part of it, at each joint the published inertia
            times the gear ratio squared (2.26e-3 kg·m²); without them only the two links turn.

    Returns:
        Joints and motors ``shoulder`` and ``elbow`` (relative to the shoulder's link); commands
        are torques [N·m], limited to the published 10 N·m.
    """
    spec = empty("dfki_double_pendulum", timestep=0.001)
    parent = spec.worldbody
    for i, name in enumerate(_PENDULUM_JOINTS):
        link = parent.add_body(name=f"{name}_link", pos=(0.0, 0.0, -_LENGTH[0] * i))
        # about the centre of mass: I − m·c²
        add_pendulum(link, name, _MASS[i], _COM[i], _INERTIA[i] - _MASS[i] * _COM[i] ** 2)
        _draw(link, _LENGTH[i])
        # rotor inertia at the joint: gear² · Ir
        spec.joint(name).armature = _GEAR**2 * _ROTOR if rotors else 0.0
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
            ctrlrange=(-_TORQUE, _TORQUE), forcerange=(-_TORQUE, _TORQUE),
        )  # fmt: skip
        motor.set_to_motor()
        parent = link
    return spec


def servo_bench_spec(
    kp: int, motor: MotorConstants | None = None, arm_mass: float = 0.0
) -> mujoco.MjSpec:
    """The XL330 bench: a mass on a massless (or thin) arm, held by a position servo.

    The firmware sets the duty to kp·error·(4096/2π)/(256·885) and the motor turns voltage into
    torque through kt/R against its back-EMF; at the nominal supply this is a position actuator
    with a damping gain and a torque limit. Friction, the rotor's inertia and the sagging supply are
    left out.

    Args:
        kp: position gain of the firmware, 100, 200 or 400 in the logs.
        motor: electrical constants; an XL330's when left out.
        arm_mass: mass of the arm, a thin rod of the bench's length [kg]; not recorded.

    Returns:
        One joint and one position actuator, both ``hinge``; commands are angles [rad].
    """
    motor = motor or MotorConstants()
    spec = empty("bam_xl330", timestep=0.0005)
    arm = spec.worldbody.add_body(name="arm")
    mass = _BENCH_MASS + arm_mass
    com = (_BENCH_MASS + 0.5 * arm_mass) * _BENCH_LENGTH / mass
    about_pivot = (_BENCH_MASS + arm_mass / 3.0) * _BENCH_LENGTH**2
    add_pendulum(arm, "hinge", mass, com, about_pivot - mass * com**2)
    _draw(arm, _BENCH_LENGTH)
    # duty per radian of error: kp·(4096/2π)/(256·885)
    duty = kp * _COUNTS / (2.0 * np.pi) / (_GAIN_UNIT * _DUTY_FULL)
    # torque = kt/R·(duty·V − kt·ω)
    stall = motor.kt / motor.resistance * motor.supply
    servo = spec.add_actuator(
        name="hinge", target="hinge", trntype=mujoco.mjtTrn.mjTRN_JOINT,
        forcerange=(-stall, stall),
    )  # fmt: skip
    servo.set_to_position(kp=stall * duty, kv=motor.kt**2 / motor.resistance)
    return spec


def so101_spec() -> mujoco.MjSpec:
    """The SO-101 arm with the servo figures published for it (friction included)."""
    return so101_model.spec(so101_model.ServoPhysics(), timestep=0.0025)


_RIGS: dict[str, Callable[[Mapping[str, object]], mujoco.MjSpec]] = {
    "sage_so101": lambda meta: so101_spec(),
    "dfki_double_pendulum": lambda meta: double_pendulum_spec(),
    "bam_xl330": lambda meta: servo_bench_spec(int(str(meta["kp"]))),
}


def spec_for(meta: Mapping[str, object]) -> mujoco.MjSpec:
    """The rig that a recording was made on, from its metadata.

    Args:
        meta: metadata of an imported recording.

    Raises:
        DataError: the format does not tell the robot.
    """
    name = str(meta.get("format"))
    if name not in _RIGS:
        raise DataError(
            f"format {name!r} does not tell the robot, so there is no MJCF to write; "
            f"{suggest(name, _RIGS)}; leave --model out"
        )
    return _RIGS[name](meta)


def write_mjcf(spec: mujoco.MjSpec, path: Path) -> None:
    """Write a rig's MJCF whole; folders on the way are made.

    Args:
        spec: a rig; it is compiled here.
        path: the XML file to write.

    Raises:
        UserError: another file is there.
    """
    spec.compile()
    path.parent.mkdir(parents=True, exist_ok=True)
    text = str(spec.to_xml())
    if path.exists() and (not path.is_file() or path.read_bytes() != text.encode()):
        raise UserError(f"{path} is there already and is another model; name another file")
    write_whole(path, text)


def empty(name: str, timestep: float, gravity: float = GRAVITY) -> mujoco.MjSpec:
    """A machine without parts, in radians, stepped implicitly.

    Args:
        name: of the model.
        timestep: physics step [s].
        gravity: along −z [m/s²].
    """
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = (0.0, 0.0, -gravity)
    return spec


def add_pendulum(body: mujoco.MjsBody, joint: str, mass: float, com: float, inertia: float) -> None:
    """A hinge about y and a thin rod's inertial: mass [kg], com [m] below, inertia [kg·m²]."""
    body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 1.0, 0.0))
    body.explicitinertial = True
    body.mass, body.ipos = mass, (0.0, 0.0, -com)
    # a point mass has no inertia of its own, which MuJoCo does not take
    across = max(inertia, _LEAST_INERTIA)
    # about the rod's own axis nothing turns; a hundredth keeps the tensor a body's
    body.inertia = (across, across, 0.01 * across)


def _draw(body: mujoco.MjsBody, length: float) -> None:
    """A capsule to look at, without mass or contact."""
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(0.0, 0.0, 0.0, 0.0, 0.0, -length),
        size=(0.01, 0.0, 0.0), mass=0.0,
    )  # fmt: skip
    geom.contype, geom.conaffinity = 0, 0
