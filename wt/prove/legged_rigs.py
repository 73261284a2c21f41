"""The robots of the trials that stand on legs: a quadruped and a humanoid, of primitives.

Both have a free joint ``base``, position servos, an IMU on the trunk, and a flat ``floor``. Only
their feet touch it, and the feet's contact parameters count (``priority``), so that one foot can be
worn and a whole floor be slippery. Sizes, masses and gains are those of machines on the market.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.prove.robot import Rig, RigLink, text

BASE, FLOOR = "base", "floor"
"""Names of the free joint and of the ground."""
FRICTION, TIME_CONSTANT = 0.8, 0.02
"""Sliding friction [-] and time constant [s] of the feet's contacts."""


@dataclass(frozen=True)
class Foot:
    """A foot, which touches the floor.

    Attributes:
        name: of the geom.
        body: the link that it is on.
        pos: its middle in the body's frame [m].
        size: radius of a ball, or half sizes of a box [m].
    """

    name: str
    body: str
    pos: tuple[float, float, float]
    size: tuple[float, ...]


@dataclass(frozen=True)
class Legged(Rig):
    """A robot on legs; ``links`` are those with a hinge, without the trunk.

    Attributes:
        trunk: name of the body that floats.
        mass: of the trunk [kg].
        box: half sizes of the trunk [m].
        centre: of that box in the trunk's frame [m].
        height: of the trunk's origin over the floor, the feet on it and joints at ``middle`` [m].
        feet: geoms that touch the floor.
    """

    trunk: str
    mass: float
    box: tuple[float, float, float]
    centre: tuple[float, float, float]
    height: float
    feet: tuple[Foot, ...]

    @property
    def bodies(self) -> tuple[str, ...]:
        """Body names, the trunk first."""
        return (self.trunk, *super().bodies)

    @property
    def middle(self) -> Float[np.ndarray, " joint"]:
        """The standing pose [rad]."""
        return np.array([link.middle for link in self.links])

    def leg(self, foot: str) -> tuple[str, ...]:
        """Joints of the leg that ends in a foot, from the foot upwards."""
        numbers = {link.body: i for i, link in enumerate(self.links)}
        body, joints = next(f.body for f in self.feet if f.name == foot), list[str]()
        while body in numbers:
            link = self.links[numbers[body]]
            joints.append(link.joint)
            body = link.parent or self.links[numbers[body] - 1].body
        return tuple(joints)

    def xml(self, step: float, gain: float, gyro: bool) -> str:
        """The MJCF; with ``gyro`` the IMU is read."""
        box = f'type="box" size="{text(self.box)}" pos="{text(self.centre)}" mass="{self.mass}"'
        sensors = '<gyro name="gyro" site="imu"/><accelerometer name="accelerometer" site="imu"/>'
        drives = "".join(self.drive(link, gain) for link in self.links)
        return (
            f'<mujoco model="{self.name}">\n'
            '<compiler angle="radian" autolimits="true"/>\n'
            f'<option timestep="{step}" integrator="implicitfast" cone="elliptic" impratio="10"/>\n'
            '<default><geom contype="0" conaffinity="0"/></default>\n'
            f'<worldbody>\n<geom name="{FLOOR}" type="plane" size="0 0 0.05" contype="1"/>\n'
            f'<body name="{self.trunk}" pos="0 0 {self.height:g}"><freejoint name="{BASE}"/>'
            f'<geom name="{self.trunk}_geom" {box}/><site name="imu"/>\n'
            f"{self._below(self.trunk)}</body>\n</worldbody>\n"
            f"<actuator>{drives}</actuator>\n"
            + (f"<sensor>{sensors}</sensor>\n" if gyro else "")
            + "</mujoco>\n"
        )

    def _below(self, parent: str) -> str:
        """The bodies that hang on one."""
        bodies = ""
        for i, link in enumerate(self.links):
            if (link.parent or self.links[i - 1].body) == parent:
                feet = "".join(_foot(foot) for foot in self.feet if foot.body == link.body)
                bodies += f"{self.shape(link)}{feet}{self._below(link.body)}</body>\n"
        return bodies


def _foot(foot: Foot) -> str:
    kind = "sphere" if len(foot.size) == 1 else "box"
    return (
        f'<geom name="{foot.name}" type="{kind}" size="{text(foot.size)}" pos="{text(foot.pos)}" '
        f'mass="0" conaffinity="1" priority="1" friction="{FRICTION}" solref="{TIME_CONSTANT} 1"/>'
    )


THIGH = SHANK = 0.21
HIP_AT, HIP_ASIDE = (0.19, 0.05), 0.085
"""Of the quadruped's hips in the trunk (x, y), and of the thighs beside them [m]."""
PAW = 0.022
"""Radius of its feet [m]."""
_BENT = 0.85  # rad, of its thighs; the knees twice that, so that feet are below the hips


def _leg(name: str) -> tuple[RigLink, RigLink, RigLink]:
    x, y = (1 if name[0] == "F" else -1), (1 if name[1] == "L" else -1)
    return (
        RigLink(f"{name}_abduct", f"{name}_shoulder", "1 0 0",
                (x * HIP_AT[0], y * HIP_AT[1], 0.0), (0.0, y * HIP_ASIDE, 0.0), 0.6, 0.04,
                (-1.0, 1.0), 0.0, 0.12, 0.01, 0.15, 50.0, 1.5, 24.0, parent="trunk"),
        RigLink(f"{name}_hip", f"{name}_thigh", "0 1 0",
                (0.0, y * HIP_ASIDE, 0.0), (0.0, 0.0, -THIGH), 1.05, 0.028,
                (-1.2, 3.0), _BENT, 0.25, 0.01, 0.15, 50.0, 1.5, 24.0),
        RigLink(f"{name}_knee", f"{name}_shank", "0 1 0",
                (0.0, 0.0, -THIGH), (0.0, 0.0, -SHANK), 0.24, 0.014,
                (-2.7, -0.5), -2 * _BENT, 0.35, 0.015, 0.15, 60.0, 1.5, 45.0),
    )  # fmt: skip


QUADRUPED_LEGS = ("FL", "FR", "RL", "RR")
QUADRUPED = Legged(
    "quadruped",
    tuple(link for name in QUADRUPED_LEGS for link in _leg(name)),
    motor=False, step=0.0005, tempo=1.0,
    trunk="trunk", mass=6.2, box=(0.19, 0.05, 0.055), centre=(0.0, 0.0, 0.0),
    height=(THIGH + SHANK) * float(np.cos(_BENT)) + PAW,
    feet=tuple(Foot(f"{n}_foot", f"{n}_shank", (0.0, 0.0, -SHANK), (PAW,)) for n in QUADRUPED_LEGS),
)  # fmt: skip

FEMUR, TIBIA, SOLE = 0.33, 0.33, 0.05
"""Of the humanoid: lengths of thigh and shin, and of the ankle over the sole [m]."""
PELVIS_AT = (0.09, -0.08)
"""Of its hips beside and below the pelvis's origin [m]."""
_KNEE = 0.5  # rad


def _side(name: str) -> tuple[RigLink, ...]:
    y = 1.0 if name == "left" else -1.0
    at = f"{name}_"
    none = (0.0, 0.0, 0.0)
    return (
        RigLink(f"{at}hip_yaw", f"{at}hip_block", "0 0 1", (0.0, y * PELVIS_AT[0], PELVIS_AT[1]),
                (0.0, 0.0, -0.03), 1.2, 0.05, (-1.0, 1.0), 0.0, 0.15, 0.02, 0.4, 200.0, 6.0, 80.0,
                parent="pelvis"),
        RigLink(f"{at}hip_roll", f"{at}hip_cross", "1 0 0", none,
                (0.04, 0.0, 0.0), 1.2, 0.045, (-0.6, 0.6), 0.0, 0.1, 0.03, 0.4, 450.0, 9.0, 140.0),
        RigLink(f"{at}hip_pitch", f"{at}thigh", "0 1 0", none,
                (0.0, 0.0, -FEMUR), 2.4, 0.055, (-2.0, 1.0), -_KNEE / 2, 0.3, 0.03, 0.4,
                450.0, 9.0, 140.0),
        RigLink(f"{at}knee", f"{at}shin", "0 1 0", (0.0, 0.0, -FEMUR),
                (0.0, 0.0, -TIBIA), 1.9, 0.042, (0.0, 2.4), _KNEE, 0.35, 0.03, 0.4,
                450.0, 9.0, 140.0),
        RigLink(f"{at}ankle_pitch", f"{at}ankle", "0 1 0", (0.0, 0.0, -TIBIA),
                (0.02, 0.0, 0.0), 0.3, 0.03, (-1.0, 0.8), -_KNEE / 2, 0.2, 0.02, 0.3,
                450.0, 9.0, 80.0),
        RigLink(f"{at}ankle_roll", f"{at}sole", "1 0 0", none,
                (0.08, 0.0, -0.03), 0.6, 0.02, (-0.5, 0.5), 0.0, 0.1, 0.02, 0.3, 350.0, 6.0, 60.0),
    )  # fmt: skip


def _arm(name: str) -> tuple[RigLink, ...]:
    y = 1.0 if name == "left" else -1.0
    at = f"{name}_"
    return (
        RigLink(f"{at}shoulder_pitch", f"{at}shoulder_block", "0 1 0", (0.0, y * 0.13, 0.27),
                (0.0, y * 0.05, 0.0), 0.7, 0.04, (-2.8, 2.0), 0.2, 0.7, 0.01, 0.2, 60.0, 2.5, 30.0,
                parent="torso"),
        RigLink(f"{at}shoulder_roll", f"{at}shoulder_cross", "1 0 0", (0.0, y * 0.05, 0.0),
                (0.0, 0.0, -0.06), 0.6, 0.035, (-1.8, 1.8), y * 0.25, 0.3, 0.01, 0.2,
                60.0, 2.5, 30.0),
        RigLink(f"{at}shoulder_yaw", f"{at}upper_arm", "0 0 1", (0.0, 0.0, -0.08),
                (0.0, 0.0, -0.14), 0.7, 0.035, (-1.8, 1.8), 0.0, 0.6, 0.01, 0.15, 40.0, 1.5, 25.0),
        RigLink(f"{at}elbow", f"{at}forearm", "0 1 0", (0.0, 0.0, -0.15),
                (0.0, 0.0, -0.22), 0.9, 0.03, (-2.4, 0.3), -0.8, 0.6, 0.01, 0.15,
                40.0, 1.5, 25.0),
    )  # fmt: skip


SIDES = ("left", "right")
HUMANOID = Legged(
    "humanoid",
    (
        *_side("left"), *_side("right"),
        RigLink("waist", "torso", "0 0 1", (0.0, 0.0, 0.08), (0.0, 0.0, 0.28), 9.5, 0.1,
                (-2.0, 2.0), 0.0, 0.5, 0.03, 0.4, 200.0, 6.0, 80.0, parent="pelvis"),
        *_arm("left"), *_arm("right"),
    ),
    motor=False, step=0.0005, tempo=0.8,
    trunk="pelvis", mass=4.0, box=(0.06, 0.09, 0.06), centre=(0.0, 0.0, -0.02),
    height=(FEMUR + TIBIA) * float(np.cos(_KNEE / 2)) + SOLE - PELVIS_AT[1],
    feet=tuple(
        Foot(f"{side}_foot", f"{side}_sole", (0.03, 0.0, 0.01 - SOLE), (0.11, 0.045, 0.01))
        for side in SIDES
    ),
)  # fmt: skip

LEGGED: dict[str, Legged] = {"quadruped": QUADRUPED, "humanoid": HUMANOID}
