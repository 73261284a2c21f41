"""A rotor of its own behind a joint's gear, for play and elasticity between motor and link."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter
from wt.physics.hooks import Stateful
from wt.physics.motion import Motion
from wt.physics.parts import add_body, add_geom, add_joint, add_tendon, compiled
from wt.physics.replay import Hidden, Stretch
from wt.physics.replay_only import ReplayOnly
from wt.physics.scene import Scene
from wt.physics.script import Script
from wt.types import Location

ROTOR_SHARE = 0.02
"""Rotor inertia as a share of the joint's, where the model has no armature to take it from."""

LOSSES = Parameter("losses", "-", 0.0, 1.0, 0.05, public=False)
"""Share of the joint's damping and dry friction that brakes its rotor; the rest brakes its link.

A model of one mass does not say where they are. Between the teeth it decides how the link swings.
"""


def split(spec: mujoco.MjSpec, joint: str, losses: float) -> tuple[float, mujoco.MjsTendon]:
    """Put a rotor between a joint's drives and its link, in place.

    The user's joint stays the link's, which is what an encoder at the output measures; the rotor
    takes over armature and drives, and a fixed tendon ``<joint>_gear`` couples the two: its length
    is the rotor's angle minus the link's.

    Args:
        spec: the model.
        joint: the joint's name.
        losses: share of the joint's damping and dry friction that the rotor takes over.

    Returns:
        (inertia of the rotor [kg·m²], the tendon, without stiffness yet).
    """
    link = spec.joint(joint)
    model = compiled(spec)
    given = model.joint(joint)
    inertia = float(link.armature)
    if inertia <= 0.0:
        inertia = ROTOR_SHARE * float(model.dof_M0[given.dofadr[0]])
    link.armature = 0.0
    friction, damping = float(link.frictionloss), np.array(link.damping)
    link.frictionloss, link.damping = (1.0 - losses) * friction, (1.0 - losses) * damping
    name, body = rotor(joint), int(given.bodyid[0])
    place = {"pos": model.body_pos[body], "quat": model.body_quat[body]}
    carrier = add_body(spec, link.parent.parent, name, **place)
    # next to no mass: what counts is the armature
    add_geom(spec, carrier, name, size=[0.005, 0.0, 0.0], mass=1e-4, contype=0, conaffinity=0)
    turning = {"type": link.type, "axis": given.axis, "pos": given.pos, "armature": inertia}
    lossy = {"frictionloss": losses * friction, "damping": losses * damping}
    add_joint(spec, carrier, name, **turning, **lossy)
    passive = int(mujoco.mjtCtrlInput.mjINPUT_NONE)  # of no drive: as friction is, at the link
    for actuator in spec.actuators:
        on_joint = actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.target == joint
        if on_joint and actuator.ctrlspec != passive:
            actuator.target = name
    tendon = add_tendon(spec, f"{joint}_gear")
    tendon.wrap_joint(name, 1.0)
    tendon.wrap_joint(joint, -1.0)
    return inertia, tendon


def rotor(joint: str) -> str:
    """Name of a joint's rotor."""
    return f"{joint}_rotor"


def motor(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsJoint:
    """The joint that a joint's drives turn: its rotor behind a gear that was split, or itself."""
    return spec.joint(rotor(joint)) or spec.joint(joint)


def braked(spec: mujoco.MjSpec, joint: str) -> list[tuple[mujoco.MjsJoint, float]]:
    """The parts of a joint that its damping brakes, each with its share of it."""
    link, turned = spec.joint(joint), motor(spec, joint)
    whole = float(link.damping[0] + turned.damping[0])
    if turned.name == joint or whole <= 0.0:
        return [(link, 1.0)]
    return [(part, float(part.damping[0]) / whole) for part in (link, turned)]


class GearEffect(Stateful, ReplayOnly):
    """Base of effects between motor and link, which only a replay with a rotor can tell.

    The last of their parameters is :data:`LOSSES`.
    """

    kind = "joint"
    stiff = True

    @property
    def n_free(self) -> int:
        """Where losses are belongs to the model, as its tolerances do: only the rest is chosen."""
        return super().n_free - LOSSES.size

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """Each gear with the losses at the link, and at the rotor where there are any."""
        joint = motion.scene.model.joint(at.name)
        lossy = bool(np.any(joint.damping)) or bool(np.any(joint.frictionloss))
        return [
            np.append(theta, losses)
            for losses in ((0.0, 1.0) if lossy else (0.0,))
            for theta in self.gears(motion, at)
        ]

    @abstractmethod
    def gears(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " _"]]:
        """Parameters to start from, without the losses."""

    def places(self, scene: Scene) -> Sequence[Location]:
        """Joints with a drive."""
        return [Location("joint", name) for name in dict.fromkeys(d.joint for d in scene.drives)]

    def followers(self, at: Location) -> Mapping[str, str]:
        """The rotor starts at the link's angle where nothing else is known."""
        return {rotor(at.name): at.name}

    def started(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, Hidden]:
        """The rotor where its drives and the gear are in balance, as fast as the link."""
        if stretch.motion is None:
            return {}
        scene = stretch.motion.scene
        dof = scene.dof(at.name)
        link = {at.name: (float(stretch.q0[dof]), float(stretch.v0[dof]))}
        balance = self.balanced(at, theta, scene, link, stretch.command[0])
        return {name: Hidden(q, v, (0.0, 0.0)) for name, (q, v) in balance.items()}

    def balanced(
        self,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        scene: Scene,
        joints: Mapping[str, tuple[float, float]],
        command: Float[np.ndarray, " actuator"],
    ) -> Mapping[str, tuple[float, float]]:
        """The rotor where its drives and the gear are in balance, as fast as the link."""
        mine = [d for d in scene.drives if d.joint == at.name]
        q, v = joints[at.name]
        here = np.array([q]), np.array([v])
        force = sum(float(d.force(command[[d.index]], *here)[0]) for d in mine)
        stiffness = sum(-d.bias[1] * d.gear**2 for d in mine)
        return {rotor(at.name): (q + self.twist(theta, force, max(stiffness, 0.0)), v)}

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """The rotor in balance where a simulation begins."""
        start = (
            f'force, stiffness = self._gear(data, "{at.name}")',
            f"twist = {self.twist_line(theta)}",
            f'data.joint("{rotor(at.name)}").qpos = data.joint("{at.name}").qpos + twist',
        )
        return Script(start=start, helpers=("gear",))

    @abstractmethod
    def twist_line(self, theta: Float[np.ndarray, " parameter"]) -> str:
        """:meth:`twist` as an expression in ``force`` and ``stiffness``."""

    @abstractmethod
    def twist(
        self, theta: Float[np.ndarray, " parameter"], force: float, stiffness: float
    ) -> float:
        """Angle by which the rotor is ahead of a link at rest [rad].

        Args:
            theta: parameters of the effect.
            force: of the drives, were the rotor at the link's angle [N·m].
            stiffness: by which that falls as the rotor turns [N·m/rad].
        """
