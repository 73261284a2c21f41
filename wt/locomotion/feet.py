"""What is sensed of the feet: for rewards, critics and figures of gait, never for an actor.

The sensors are added to the description of a robot before it is compiled; they change nothing
about its motion. Their values are those of the last physics step's beginning, 5 ms ago.
"""

from __future__ import annotations

import mujoco
import numpy as np

from wt.worlds.legged import Herd, LeggedRobot

Array = np.ndarray

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
    """The feet of a herd; F of each robot.

    Attributes:
        contact: which touch the ground, (N, F) bool.
        force: of contact, (N, F) [N].
        clearance: of their sites over where they rest on the ground, (N, F) [m].
        speed: horizontal, (N, F) [m/s].
        air: how long each is in the air, and for the step of touching down how long it was,
            (N, F) [s].
        stance: how long each is on the ground, likewise, (N, F) [s].
        landed: which touched down in this step, (N, F) bool.
        others: contacts of other parts with the ground, such as knees and trunk, (N,).
    """

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

    def forget(self, ids: Array) -> None:
        """Some robots started anew."""
        self.contact[ids], self.landed[ids], self.others[ids] = True, False, 0.0
        for values in (self.air, self.stance, self.force, self.clearance, self.speed):
            values[ids] = 0.0
