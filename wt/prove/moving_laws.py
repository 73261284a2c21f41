"""A payload that moves: ``body.payload_moving``, as a ball in a box, on rails, or sloshing.

The parameters ``mass`` [kg] and ``travel`` [m] are the payload's and how far its centre can go from
one end to the other, along x of the body where that differs; ``position`` [m] is the middle of it
in the body's frame. All are bodies of their own that MuJoCo moves along.
"""

from __future__ import annotations

import mujoco
import numpy as np

from wt.prove.hidden import Parameters, Plant, WorldLaw

_BIT = 4  # of the box's walls, which nothing but the ball feels
_WALL = 0.03  # half the thickness of the walls [m]: nothing gets through


class HiddenRollingBall(WorldLaw):
    """A ball of ``radius`` rolls in a closed box without mass, ``travel`` × ``breadth`` free."""

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Six walls on the body, and a free ball in the world."""
        radius, travel = self.number("radius"), self.number("travel")
        # the lid is 2 mm clear of the ball
        room = np.array([travel, self.number("breadth"), 0.004])
        half = radius + 0.5 * room
        at = self.vector("position")
        for axis in range(3):
            for sign in (-1.0, 1.0):
                size, pos = half + 2 * _WALL, at.copy()
                size[axis] = _WALL
                pos[axis] += sign * (half[axis] + _WALL)
                spec.body(self.place).add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos, mass=0.0,
                    contype=_BIT, conaffinity=0,
                )  # fmt: skip
        ball = spec.worldbody.add_body(name="ball")
        ball.add_freejoint(name="ball")
        ball.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=self.number("mass"),
            contype=0, conaffinity=_BIT, priority=2, condim=6, friction=[0.4, 0.002, 0.0005],
            solref=[0.006, 0.6],
        )  # fmt: skip

    def settle(self, plant: Plant) -> None:
        """In the middle of the box, wherever the body is."""
        body = plant.data.body(self.place)
        at = body.xpos + body.xmat.reshape(3, 3) @ self.vector("position")
        first = int(plant.model.joint("ball").qposadr[0])
        plant.data.qpos[first : first + 7] = [*at, 1.0, 0.0, 0.0, 0.0]


class HiddenRails(WorldLaw):
    """A block that slides along x of the body over ``travel``, with viscous ``damping`` [N·s/m]."""

    axes: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """A body with a slide for each axis, stopped at both ends."""
        block = spec.body(self.place).add_body(name="block", pos=self.vector("position"))
        block.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], mass=self.number("mass"),
            contype=0, conaffinity=0,
        )  # fmt: skip
        reach = 0.5 * self.number("travel")
        for i, axis in enumerate(self.axes):
            block.add_joint(
                name=f"rail{i}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, limited=True,
                range=[-reach, reach], solref_limit=[0.006, 0.6],
            )  # fmt: skip

    def bind(self, plant: Plant) -> None:
        """Look up the slides."""
        joints = [plant.model.joint(f"rail{i}") for i in range(len(self.axes))]
        self._q = np.array([int(joint.qposadr[0]) for joint in joints])
        self._v = np.array([int(joint.dofadr[0]) for joint in joints])

    def act(self, plant: Plant, t: float) -> None:
        """−damping·v."""
        v = plant.data.qvel[self._v]
        plant.data.qfrc_applied[self._v] = -self.number("damping") * v


class HiddenPayloadSlosh(HiddenRails):
    """A liquid as its first mode: the block swings level in x and y at ``frequency`` [rad/s].

    mass·ẍ = −mass·frequency²·x − 2·ratio·mass·frequency·ẋ beside gravity; ``travel`` is where the
    walls are (H. N. Abramson, NASA SP-106, 1966, chapter 6, for the pendulum that this stands for).
    """

    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        x, v = plant.data.qpos[self._q], plant.data.qvel[self._v]
        w, m = self.number("frequency"), self.number("mass")
        pull = m * w * w * x + 2 * self.number("ratio") * m * w * v
        plant.data.qfrc_applied[self._v] = -pull


LAWS: dict[str, type[WorldLaw]] = {
    "body.payload_moving": HiddenRollingBall,
    "payload.rails": HiddenRails,
    "payload.slosh": HiddenPayloadSlosh,
}
"""The first is what the effect is called; the others are other payloads of the same effect."""

_NEEDS = {
    "body.payload_moving": ("radius", "breadth"),
    "payload.rails": ("damping",),
    "payload.slosh": ("frequency", "ratio"),
}


def variant(parameters: Parameters, rng: np.random.Generator) -> tuple[str, Parameters]:
    """One kind of moving payload: its law, and those of the parameters that it has."""
    law = str(rng.choice(list(LAWS)))
    kept = ("mass", "travel", "position", *_NEEDS[law])
    return law, {name: parameters[name] for name in kept}
