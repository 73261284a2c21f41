"""Laws of contacts: the ``contact.*`` effects. Feet decide, as in the nominal model."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from wt.prove.hidden import HiddenLaw, Plant, WorldLaw
from wt.prove.legged_rigs import FLOOR, Legged


class _HiddenGround(WorldLaw):
    """Changes one foot, or all of them when the floor is to blame."""

    def feet(self, plant: Plant) -> list[int]:
        """MuJoCo's ids of the geoms."""
        assert isinstance(plant.rig, Legged)
        names = [foot.name for foot in plant.rig.feet]
        touching = names if self.place == FLOOR else [self.place]
        return [int(plant.model.geom(name).id) for name in touching]


class HiddenContactFriction(_HiddenGround):
    """Sliding friction of a worn foot, or of a slippery floor, is ``friction``."""

    def bind(self, plant: Plant) -> None:
        """Once."""
        for geom in self.feet(plant):
            plant.model.geom_friction[geom, 0] = self.number("friction")


class HiddenContactCompliance(_HiddenGround):
    """A foot or a floor that gives: contacts have ``time_constant`` (critically damped)."""

    def bind(self, plant: Plant) -> None:
        """Once."""
        for geom in self.feet(plant):
            plant.model.geom_solref[geom, 0] = self.number("time_constant")


class HiddenFloorTolerance(_HiddenGround):
    """No effect but a tolerance: ``friction`` and ``time_constant`` × factors, as floors are."""

    def bind(self, plant: Plant) -> None:
        """Once, before anything that is hidden."""
        for geom in self.feet(plant):
            plant.model.geom_friction[geom, 0] *= self.number("friction")
            plant.model.geom_solref[geom, 0] *= self.number("time_constant")


class HiddenSlope(WorldLaw):
    """The floor descends by ``angle`` towards azimuth ``direction``; gravity stays as it is."""

    def bind(self, plant: Plant) -> None:
        """Turn the plane about the world's origin."""
        d, half = self.number("direction"), 0.5 * self.number("angle")
        # about the level axis that is a quarter turn left of the descent
        axis = np.array([-math.sin(d), math.cos(d), 0.0])
        self._turn = np.array([math.cos(half), *(math.sin(half) * axis)])
        plant.model.geom_quat[plant.model.geom(FLOOR).id] = self._turn

    def settle(self, plant: Plant) -> None:
        """The robot stands as it would on level ground, turned with the floor."""
        place, turn = plant.data.qpos[:3].copy(), plant.data.qpos[3:7].copy()
        mujoco.mju_rotVecQuat(plant.data.qpos[:3], place, self._turn)
        mujoco.mju_mulQuat(plant.data.qpos[3:7], self._turn, turn)


class HiddenObstacle(WorldLaw):
    """A wall that stands in the way: its face is at ``position`` and looks along ``normal``."""

    HALF = (0.2, 1.5, 1.5)  # m, deep, and wide enough that nothing goes around it
    BIT = 8  # of the wall, which only the arm feels

    def edit(self, spec: mujoco.MjSpec) -> None:
        """A box of the world that all links but the first can touch."""
        normal = self.vector("normal")
        turn = np.zeros(4)
        mujoco.mju_quatZ2Vec(turn, normal)
        spec.worldbody.add_geom(
            name="wall", type=mujoco.mjtGeom.mjGEOM_BOX, quat=turn,
            pos=self.vector("position") - self.HALF[0] * normal,
            size=[self.HALF[1], self.HALF[2], self.HALF[0]],
            contype=self.BIT, conaffinity=0, friction=[0.25, 0.005, 0.0001],
            solref=[0.008, 1.0], solimp=[0.02, 0.95, 0.002, 0.5, 2],
        )  # fmt: skip
        for body in spec.bodies[2:]:
            for geom in body.geoms:
                geom.conaffinity = self.BIT


LAWS: dict[str, type[HiddenLaw]] = {
    "contact.friction": HiddenContactFriction,
    "contact.compliance": HiddenContactCompliance,
    "contact.slope": HiddenSlope,
    "contact.obstacle": HiddenObstacle,
}
