"""Sensors of the feet: for rewards, critics and figures of gait, never for an actor.

The sensors are added to the description of a robot before it is compiled; they change nothing
about its motion. Their values are those of the last physics step's beginning, 5 ms ago.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from wt.worlds.legged import Herd, LeggedRobot

_PREFIX = "feet/"
_FOUND = 1  # bit of the contact sensor's data field "found", the number of contacts
_FORCE = 2  # … and "force"
_NET = 3  # its reduction "netforce"
_WIDTH = 10  # numbers a foot: position, velocity, contacts, force


def add_sensors(spec: mujoco.MjSpec, robot: LeggedRobot) -> None:
    """Add position, velocity and contacts of each foot, and all contacts with the ground."""
    body, geom = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_GEOM
    sole = body if robot.sole_bodies else geom
    for foot, touching in zip(robot.feet, robot.sole_bodies or robot.sole_geoms, strict=True):
        for kind in (mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMELINVEL):
            spec.add_sensor(
                name=f"{_PREFIX}{foot}/{kind.name}", type=kind,
                objtype=mujoco.mjtObj.mjOBJ_SITE, objname=foot,
            )  # fmt: skip
        spec.add_sensor(
            name=f"{_PREFIX}{foot}/force", type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=sole, objname=touching, intprm=[_FOUND | _FORCE, _NET, 1],
        )  # fmt: skip
    spec.add_sensor(
        name=f"{_PREFIX}all", type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY, objname=robot.trunk,
        reftype=body, refname="world", intprm=[_FOUND, 0, 1],  # not with what it carries
    )  # fmt: skip


class FootSensors:
    """The feet of a herd.

    Attributes:
        contact: true where a foot touches the ground.
        force: of contact [N].
        clearance: height of their sites over where they rest on the ground [m].
        speed: horizontal [m/s].
        air: time that each has been in the air, and for the step of touching down the time that it
            was [s].
        stance: time that each has been on the ground, likewise [s].
        landed: true where a foot touched down in this step.
        others: contacts of other parts with the ground, such as knees and trunk.
    """

    contact: Bool[np.ndarray, "robot foot"]
    force: Float32[np.ndarray, "robot foot"]
    clearance: Float[np.ndarray, "robot foot"]
    speed: Float32[np.ndarray, "robot foot"]
    air: Float32[np.ndarray, "robot foot"]
    stance: Float32[np.ndarray, "robot foot"]
    landed: Bool[np.ndarray, "robot foot"]
    others: Float32[np.ndarray, " robot"]

    def __init__(self, herd: Herd) -> None:
        """Find the sensors.

        Args:
            herd: of a model with :func:`add_sensors`.
        """
        model, robot = herd.model, herd.robot
        self._herd, self._sensordata = herd, herd.batch.bind("sensordata")
        first = model.sensor(f"{_PREFIX}{robot.feet[0]}/mjSENS_FRAMEPOS").adr[0]
        count = len(robot.feet)
        self._block = slice(first, first + _WIDTH * count + 1)
        shape = (herd.size, count)
        self.contact = np.ones(shape, bool)
        self.landed = np.zeros(shape, bool)
        self.others = np.zeros(herd.size, np.float32)
        self.force, self.clearance, self.speed, self.air, self.stance = (
            np.zeros(shape, np.float32) for _ in range(5)
        )

    def update(self) -> None:
        """Take in what the last control step did."""
        dt = np.float32(self._herd.dt)
        sensed = self._sensordata[:, self._block].astype(np.float32)
        values = sensed[:, :-1].reshape(*self.contact.shape, _WIDTH)
        x, y, z, vx, vy = (values[..., i] for i in range(5))
        np.sqrt(vx * vx + vy * vy, out=self.speed)
        self.force = np.sqrt(np.square(values[..., 7:]).sum(-1))
        touched = values[..., 6] > 0
        self.others = sensed[:, -1] - values[..., 6].sum(1)
        # a time counts on through the step in which it ends, and from there anew
        self.landed = touched & ~self.contact
        self.air *= ~self.contact
        self.air += dt * ~(touched & self.contact)
        self.stance *= self.contact
        self.stance += dt * touched
        self.contact = touched
        ground = self._herd.ground.height(x, y)
        self.clearance = z - np.float32(self._herd.robot.foot_rest) - ground

    def forget(self, ids: Int[np.ndarray, " restarted"]) -> None:
        """Forget the history of robots that started anew."""
        self.contact[ids], self.landed[ids], self.others[ids] = True, False, 0.0
        for values in (self.air, self.stance, self.force, self.clearance, self.speed):
            values[ids] = 0.0
