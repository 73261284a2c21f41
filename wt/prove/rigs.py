"""The robots of the trials, built from primitives: pendulums and arms of two to six joints.

Each is a chain in open air: no contacts, gravity −z, one actuator a joint unless it is passive.
Position servos give τ = kp·(u − q) − kv·q̇, motors give τ = u; both are clipped at ``limit``. Links
are capsules whose masses are given, so that everybody computes the same inertias from the file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

RigName = Literal[
    "pendulum", "pendulum_motor", "arm2_passive", "arm3", "arm3_motor", "arm6"
]  # fmt: skip


@dataclass(frozen=True)
class Link:
    """One body of the chain with the joint that carries it.

    Attributes:
        joint: name of the joint; its actuator is ``<joint>_drive``.
        body: name of the body.
        axis: joint axis in the parent's frame.
        pos: joint position in the parent's frame [m].
        to: end of the capsule in the body's frame [m].
        mass: mass [kg].
        radius: capsule radius [m].
        span: joint range (low, high) [rad].
        middle: what motions move around [rad].
        amplitude: how far motions go from there [rad].
        armature: rotor inertia at the joint [kg·m²].
        damping: viscous friction [N·m·s/rad].
        kp: servo stiffness [N·m/rad].
        kv: servo damping [N·m·s/rad].
        limit: largest torque [N·m].
        driven: whether an actuator drives the joint; gains and limit are 0 if not.
    """

    joint: str
    body: str
    axis: str
    pos: tuple[float, float, float]
    to: tuple[float, float, float]
    mass: float
    radius: float
    span: tuple[float, float]
    middle: float
    amplitude: float
    armature: float
    damping: float
    kp: float
    kv: float
    limit: float
    driven: bool = True


@dataclass(frozen=True)
class Rig:
    """A robot.

    Attributes:
        name: its name.
        links: from the base outwards.
        motor: torque motors instead of position servos; ``kp`` and ``kv`` are then those of the
            controller outside the model.
        step: time step of the hidden world [s].
        tempo: how fast motions are, relative to the six-joint arm's.
    """

    name: str
    links: tuple[Link, ...]
    motor: bool
    step: float
    tempo: float

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names from the base outwards."""
        return tuple(link.joint for link in self.links)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Body names from the base outwards."""
        return tuple(link.body for link in self.links)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Actuator names in the order of the joints they drive."""
        return tuple(f"{link.joint}_drive" for link in self.links if link.driven)

    def hanging(self, pose: Iterable[float]) -> list[float]:
        """A pose [rad] with its passive joints hanging down, in a chain of parallel axes."""
        found: list[float] = []
        for link, angle in zip(self.links, pose, strict=True):
            found.append(float(angle) if link.driven else -sum(found))
        return found


PENDULUM = (
    Link("hinge", "rod", "0 1 0", (0.0, 0.0, 1.0), (0.0, 0.0, -0.4), 1.2, 0.03,
         (-2.6, 2.6), 0.4, 1.2, 0.01, 0.05, 30.0, 2.0, 30.0),
)  # fmt: skip

PASSIVE = (
    Link("crank", "crank_arm", "0 1 0", (0.0, 0.0, 1.0), (0.0, 0.0, -0.3), 1.0, 0.03,
         (-2.6, 2.6), 0.3, 0.6, 0.02, 0.1, 60.0, 3.5, 40.0),
    Link("trailer", "bob", "0 1 0", (0.0, 0.0, -0.3), (0.0, 0.0, -0.25), 0.6, 0.025,
         (-3.1, 3.1), 0.0, 1.0, 0.001, 0.02, 0.0, 0.0, 0.0, driven=False),
)  # fmt: skip

ARM3 = (
    Link("waist", "turret", "0 0 1", (0.0, 0.0, 0.1), (0.0, 0.0, 0.2), 2.0, 0.06,
         (-2.8, 2.8), 0.0, 0.9, 0.08, 0.6, 180.0, 18.0, 80.0),
    Link("shoulder", "upper", "0 1 0", (0.0, 0.05, 0.2), (0.3, 0.0, 0.0), 1.6, 0.04,
         (-2.0, 1.6), -0.5, 0.6, 0.08, 0.6, 260.0, 24.0, 120.0),
    Link("elbow", "fore", "0 1 0", (0.3, 0.0, 0.0), (0.26, 0.03, 0.0), 0.9, 0.035,
         (-2.4, 2.4), 0.7, 0.8, 0.04, 0.3, 120.0, 9.0, 60.0),
)  # fmt: skip

ARM6 = (
    Link("base_yaw", "shoulder_block", "0 0 1", (0.0, 0.0, 0.12), (0.0, 0.06, 0.06), 1.2, 0.05,
         (-2.9, 2.9), 0.0, 0.9, 0.10, 0.8, 260.0, 26.0, 120.0),
    Link("shoulder_pitch", "upper_arm", "0 1 0", (0.0, 0.09, 0.06), (0.32, 0.0, 0.0), 1.5, 0.045,
         (-2.6, 1.0), -1.0, 0.6, 0.10, 0.8, 320.0, 30.0, 120.0),
    Link("elbow_pitch", "forearm", "0 1 0", (0.32, 0.0, 0.0), (0.24, -0.02, 0.0), 1.0, 0.04,
         (-2.6, 2.6), 1.1, 0.7, 0.06, 0.5, 220.0, 16.0, 80.0),
    Link("wrist_roll", "wrist_block", "1 0 0", (0.26, -0.02, 0.0), (0.06, 0.02, 0.01), 0.6, 0.032,
         (-2.9, 2.9), 0.2, 1.0, 0.015, 0.12, 45.0, 2.4, 25.0),
    Link("wrist_pitch", "hand_block", "0 1 0", (0.08, 0.02, 0.0), (0.06, 0.0, 0.01), 0.4, 0.03,
         (-2.1, 2.1), 0.5, 0.9, 0.015, 0.12, 45.0, 2.4, 25.0),
    Link("flange_roll", "gripper", "1 0 0", (0.07, 0.0, 0.0), (0.07, 0.035, 0.01), 0.45, 0.028,
         (-2.9, 2.9), -0.2, 1.1, 0.006, 0.06, 18.0, 1.0, 12.0),
)  # fmt: skip

RIGS: dict[str, Rig] = {
    "pendulum": Rig("pendulum", PENDULUM, False, 0.00025, 1.2),
    "pendulum_motor": Rig("pendulum_motor", PENDULUM, True, 0.00025, 1.2),
    "arm2_passive": Rig("arm2_passive", PASSIVE, False, 0.0005, 0.9),
    "arm3": Rig("arm3", ARM3, False, 0.0005, 1.0),
    "arm3_motor": Rig("arm3_motor", ARM3, True, 0.0005, 1.0),
    "arm6": Rig("arm6", ARM6, False, 0.0005, 1.0),
}


def nominal_xml(rig: Rig, step: float = 0.002, gain: float = 1.0, gyro: bool = False) -> str:
    """The MJCF that a diagnosis is given.

    Args:
        rig: the robot.
        step: its time step [s].
        gain: factor on servo stiffness, with the damping following by its root.
        gyro: whether the last body carries a gyro and the first joint an encoder sensor.
    """
    body = ""
    for link in rig.links:
        body += (
            f'<body name="{link.body}" pos="{_text(link.pos)}">'
            f'<joint name="{link.joint}" axis="{link.axis}" range="{_text(link.span)}" '
            f'armature="{link.armature}" damping="{link.damping}"/>'
            f'<geom name="{link.body}_geom" type="capsule" size="{link.radius}" '
            f'fromto="0 0 0 {_text(link.to)}" mass="{link.mass}"/>'
        )
    last = rig.links[-1]
    body += f'<site name="tip" pos="{_text(last.to)}"/>' + "</body>" * len(rig.links)
    drives = "".join(_drive(rig, link, gain) for link in rig.links if link.driven)
    sensors = f'<jointpos name="encoder" joint="{rig.joints[0]}"/><gyro name="gyro" site="tip"/>'
    return (
        f'<mujoco model="{rig.name}">\n'
        '<compiler angle="radian" autolimits="true"/>\n'
        f'<option timestep="{step}" integrator="implicitfast"/>\n'
        '<default><geom contype="0" conaffinity="0"/></default>\n'
        f"<worldbody>{body}</worldbody>\n<actuator>{drives}</actuator>\n"
        + (f"<sensor>{sensors}</sensor>\n" if gyro else "")
        + "</mujoco>\n"
    )


def _drive(rig: Rig, link: Link, gain: float) -> str:
    common = f'name="{link.joint}_drive" joint="{link.joint}"'
    if rig.motor:
        return f'<motor {common} ctrlrange="{-link.limit} {link.limit}"/>'
    return (
        f'<position {common} kp="{link.kp * gain:.6g}" kv="{link.kv * gain**0.5:.6g}" '
        f'forcerange="{-link.limit} {link.limit}" ctrlrange="{_text(link.span)}"/>'
    )


def _text(values: tuple[float, ...]) -> str:
    return " ".join(f"{v:g}" for v in values)
