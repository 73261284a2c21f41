"""The robots of the trials: chains of links in open air, and their MJCF.

Position servos give τ = kp·(u − q) − kv·q̇, motors give τ = u; both are clipped at ``limit``. Links
are capsules whose masses are given, so that everybody computes the same inertias from the file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class RigLink:
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
        middle: centre of motions [rad].
        amplitude: largest excursion of motions from there [rad].
        armature: rotor inertia at the joint [kg·m²].
        damping: viscous friction [N·m·s/rad].
        kp: servo stiffness [N·m/rad].
        kv: servo damping [N·m·s/rad].
        limit: largest torque [N·m].
        driven: whether an actuator drives the joint; gains and limit are 0 if not.
        parent: body that it hangs on; "" for that of the link before.
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
    parent: str = ""


@dataclass(frozen=True)
class Rig:
    """A robot.

    Attributes:
        name: its name.
        links: from the base outwards.
        motor: torque motors instead of position servos; ``kp`` and ``kv`` are then those of the
            controller outside the model.
        step: time step of the hidden world [s].
        tempo: speed of motions relative to the six-joint arm's.
    """

    name: str
    links: tuple[RigLink, ...]
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
        angles: list[float] = []
        for link, angle in zip(self.links, pose, strict=True):
            angles.append(float(angle) if link.driven else -sum(angles))
        return angles

    def xml(self, step: float, gain: float, gyro: bool) -> str:
        """The MJCF; see :func:`wt.prove.rigs.nominal_xml`."""
        body = "".join(self.shape(link) for link in self.links)
        last = self.links[-1]
        body += f'<site name="tip" pos="{text(last.to)}"/>' + "</body>" * len(self.links)
        drives = "".join(self.drive(link, gain) for link in self.links if link.driven)
        sensors = (
            f'<jointpos name="encoder" joint="{self.joints[0]}"/><gyro name="gyro" site="tip"/>'
        )
        return (
            f'<mujoco model="{self.name}">\n'
            '<compiler angle="radian" autolimits="true"/>\n'
            f'<option timestep="{step}" integrator="implicitfast"/>\n'
            '<default><geom contype="0" conaffinity="0"/></default>\n'
            f"<worldbody>{body}</worldbody>\n<actuator>{drives}</actuator>\n"
            + (f"<sensor>{sensors}</sensor>\n" if gyro else "")
            + "</mujoco>\n"
        )

    @staticmethod
    def shape(link: RigLink) -> str:
        """One link's body, which is left open."""
        return (
            f'<body name="{link.body}" pos="{text(link.pos)}">'
            f'<joint name="{link.joint}" axis="{link.axis}" range="{text(link.span)}" '
            f'armature="{link.armature}" damping="{link.damping}"/>'
            f'<geom name="{link.body}_geom" type="capsule" size="{link.radius}" '
            f'fromto="0 0 0 {text(link.to)}" mass="{link.mass}"/>'
        )

    def drive(self, link: RigLink, gain: float) -> str:
        """One actuator."""
        common = f'name="{link.joint}_drive" joint="{link.joint}"'
        if self.motor:
            return f'<motor {common} ctrlrange="{-link.limit} {link.limit}"/>'
        return (
            f'<position {common} kp="{link.kp * gain:.6g}" kv="{link.kv * gain**0.5:.6g}" '
            f'forcerange="{-link.limit} {link.limit}" ctrlrange="{text(link.span)}"/>'
        )


def text(values: Iterable[float]) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{v:g}" for v in values)
