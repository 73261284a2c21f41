"""Laws outside every list of effects, on robots with legs."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float

from wt.prove.hidden import HiddenLaw, Plant, WorldLaw


def push(
    plant: Plant, body: int, point: Float[np.ndarray, " 3"], force: Float[np.ndarray, " 3"]
) -> None:
    """Add a force [N] that acts on a body at a point of the world [m]."""
    wrench = plant.data.xfrc_applied[body]
    wrench[:3] += force
    wrench[3:] += np.cross(point - plant.data.xipos[body], force)


class HiddenStickyFoot(WorldLaw):
    """Outsider: a foot in glue, held down by ``pull`` [N] until it is up by more than ``reach``.

    pull·exp(−(gap/reach)²), gap the foot's height over a level floor: at rest the floor carries it.
    """

    def bind(self, plant: Plant) -> None:
        """Look up foot and body."""
        self._geom = int(plant.model.geom(self.place).id)
        self._body = int(plant.model.geom_bodyid[self._geom])
        self._radius = float(plant.model.geom_size[self._geom][0])

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        at = plant.data.geom_xpos[self._geom] - np.array([0.0, 0.0, self._radius])
        away = max(float(at[2]), 0.0) / self.number("reach")
        pull = self.number("pull") * math.exp(-min(away * away, 50.0))
        push(plant, self._body, at, np.array([0.0, 0.0, -pull]))


class HiddenLoosePad(WorldLaw):
    """Outsider: a foot's pad has come loose and slides along the shank by ``gap`` [m]."""

    def edit(self, spec: mujoco.MjSpec) -> None:
        """The foot's ball on a body of its own, between two stops."""
        geom = spec.geom(self.place)
        pos, size, friction, solref = (
            geom.pos.copy(), geom.size.copy(), geom.friction.copy(), geom.solref.copy(),
        )  # fmt: skip
        shank = geom.parent
        spec.delete(geom)
        pad = shank.add_body(name="pad", pos=pos)
        pad.add_joint(
            name="pad", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1), limited=True,
            range=[0.0, self.number("gap")], solref_limit=[0.004, 1.0],
        )  # fmt: skip
        pad.add_geom(
            name=self.place, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, mass=0.04,
            contype=0, conaffinity=1, priority=1, friction=friction, solref=solref,
        )  # fmt: skip


class HiddenTrailingCable(WorldLaw):
    """Outsider: a cable that the trunk drags over the floor, heavier the more is pulled out.

    −(level + more·distance)·v/√(|v|² + 0.02²) of the level velocity v, distance [m] from where the
    recording started.
    """

    def bind(self, plant: Plant) -> None:
        """Look up the body."""
        self._body, self._twist = plant.body(self.place), np.zeros(6)
        self._start: Float[np.ndarray, " 2"] | None = None

    def start(self) -> None:
        """From here the cable is pulled out."""
        self._start = None

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(plant.model, plant.data, kind, self._body, self._twist, 0)
        at, v = plant.data.xipos[self._body], self._twist[3:5]
        if self._start is None:
            self._start = at[:2].copy()
        level = self.number("level") + self.number("more") * math.dist(at[:2], self._start)
        plant.data.xfrc_applied[self._body, :2] -= level * v / math.hypot(*v, 0.02)


LAWS: dict[str, type[HiddenLaw]] = {
    "outsider.sticky_foot": HiddenStickyFoot,
    "outsider.loose_pad": HiddenLoosePad,
    "outsider.trailing_cable": HiddenTrailingCable,
}
