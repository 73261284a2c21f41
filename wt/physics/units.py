"""Units follow the joint: effects state those of a hinge, and a slide has its own.

On a hinge a generalised force is a torque [N·m] and a position an angle [rad]; on a slide they
are a force [N] and a length [m]. The figures are the same, since MuJoCo's are. What stands at a
body, a geom or the world has no joint, and its unit stays as it is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco

from wt.physics.scene import Scene
from wt.types import Location

_ON_SLIDES = (("N·m", "N"), ("kg·m²", "kg"), ("1/rev", "1/(2π m)"), ("rad", "m"))
"""What a part of a hinge's unit is on a slide, in the order in which they are replaced."""


@dataclass(frozen=True)
class Units:
    """Units at a place, and values as people say them.

    Attributes:
        slide: whether its joint slides.
    """

    slide: bool = False

    def of(self, hinge: str) -> str:
        """What a hinge's unit is here, e.g. ``"N·m·s/rad"`` is ``"N·s/m"`` on a slide."""
        for part, own in _ON_SLIDES if self.slide else ():
            hinge = hinge.replace(part, own)
        return hinge

    @property
    def force(self) -> str:
        """Unit of a generalised force."""
        return self.of("N·m")

    @property
    def position(self) -> str:
        """Unit of a joint's position."""
        return self.of("rad")

    @property
    def speed(self) -> str:
        """Unit of a joint's velocity."""
        return self.of("rad/s")

    @property
    def stiffness(self) -> str:
        """Unit of a force per position."""
        return self.of("N·m/rad")

    def distance(self, value: float, digits: int = 3) -> str:
        """A difference of positions [rad or m], in degrees or mm, e.g. ``"1.2°"``."""
        if not self.slide:
            return f"{math.degrees(value):.{digits}g}°"
        return f"{value:.{digits}g} m" if abs(value) >= 1.0 else f"{1e3 * value:.{digits}g} mm"


HINGE, SLIDE = Units(), Units(slide=True)


def units_at(scene: Scene, at: Location) -> Units:
    """Units at a place: those of its joint; of several joints, a slide's if all of them slide.

    Args:
        scene: the machine.
        at: a joint, what drives or measures one, a pair of them or ``all``; or any other place,
            whose units are as stated.
    """
    joints = _joints(scene, at)
    slides = [scene.model.joint(j).type[0] == mujoco.mjtJoint.mjJNT_SLIDE for j in joints]
    return SLIDE if slides and all(slides) else HINGE


def unit_at(scene: Scene, at: Location, unit: str) -> str:
    """What a hinge's unit is at a place, see :func:`units_at`."""
    return units_at(scene, at).of(unit)


def column_unit(scene: Scene, column: str) -> str:
    """Unit of a recorded column, e.g. ``"rad/s"``; "" where the model does not tell it."""
    group, _, name = column.partition("/")
    units = units_at(scene, Location("joint" if group in ("qpos", "qvel") else "actuator", name))
    if group in ("qpos", "qvel"):
        return units.position if group == "qpos" else units.speed
    known = mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_ACTUATOR, name) >= 0
    return command_unit(scene.model, name, units) if group == "ctrl" and known else ""


def command_unit(model: mujoco.MjModel, actuator: str, units: Units) -> str:
    """Unit of a command: of the joint's position for a servo, of its force for a motor.

    Where gains and gear scale it, so much of that as a command of 1 asks for: ``0.5 rad``. A dash
    where the drive's law is not affine.

    Args:
        model: that has the actuator.
        actuator: its name.
        units: at its joint.
    """
    drive = model.actuator(actuator)
    biases = mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE
    affine = drive.gaintype[0] == mujoco.mjtGain.mjGAIN_FIXED
    affine &= any(drive.biastype[0] == bias for bias in biases)
    gain, gear, (_, position, speed) = drive.gainprm[0], drive.gear[0], drive.biasprm[:3]
    if not affine or not gain * gear:
        return "-"
    # force = gear (gain u + position gear q + speed gear q̇): a servo rests where that is 0
    if position:
        scale, unit = -gain / (position * gear), units.position
    elif speed:
        scale, unit = -gain / (speed * gear), units.speed
    else:
        scale, unit = gain * gear, units.force
    if drive.dyntype[0] == mujoco.mjtDyn.mjDYN_INTEGRATOR:
        unit = f"{unit}/s"
    return unit if math.isclose(scale, 1.0, rel_tol=1e-5) else f"{scale:.3g} {unit}"


def _joints(scene: Scene, at: Location) -> list[str]:
    """The joints that a place stands for; none for bodies, geoms and the world."""
    if at.kind not in ("joint", "actuator", "sensor", "pair"):
        return []
    if at.name == "all":
        return list(scene.joints)
    names = at.name.split("+") if at.kind == "pair" else [at.name]
    joints = [j for name in names if (j := _joint(scene, name, at.kind))]
    return joints if len(joints) == len(names) else []


def _joint(scene: Scene, name: str, kind: str) -> str | None:
    """The joint of that name, or that an actuator or a sensor of that name is at."""
    m = scene.model
    if kind == "actuator" or (kind == "pair" and name not in scene.joints):
        return next((d.joint for d in scene.drives if d.name == name), None)
    if name in scene.joints:
        return name
    i = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_SENSOR, name)
    at_joint = i >= 0 and m.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_JOINT
    return str(m.joint(m.sensor_objid[i]).name) if at_joint else None
