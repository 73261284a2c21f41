"""Laws on bodies, on the world and between joints; positions in metres, world frame."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from wt.prove.hidden import HiddenLaw, Plant, WorldLaw


class HiddenMass(WorldLaw):
    """Mass and inertia × ``factor``."""

    def bind(self, plant: Plant) -> None:
        """Once."""
        body = plant.body(self.place)
        plant.model.body_mass[body] *= self.number("factor")
        plant.model.body_inertia[body] *= self.number("factor")


class HiddenComShift(WorldLaw):
    """Centre of mass moved by ``shift`` in the body's frame, the inertia about it unchanged."""

    def bind(self, plant: Plant) -> None:
        """Once."""
        plant.model.body_ipos[plant.body(self.place)] += self.vector("shift")


class HiddenInertia(WorldLaw):
    """Inertia about the centre of mass × ``factor``, the mass unchanged."""

    def bind(self, plant: Plant) -> None:
        """Once."""
        plant.model.body_inertia[plant.body(self.place)] *= self.number("factor")


class HiddenPayload(WorldLaw):
    """A small ball of ``mass`` welded on at ``position`` in the body's frame."""

    def edit(self, spec: mujoco.MjSpec) -> None:
        """A body of its own without a joint."""
        ball = spec.body(self.place).add_body(name="load", pos=self.vector("position"))
        ball.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.008, 0, 0],
            mass=self.number("mass"),
            contype=0,
            conaffinity=0,
        )


class HiddenBodyForce(WorldLaw):
    """Constant ``force`` at the centre of mass."""

    def bind(self, plant: Plant) -> None:
        """Look up the body."""
        self._body, self._force = plant.body(self.place), self.vector("force")

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        plant.data.xfrc_applied[self._body, :3] += self._force


class HiddenIntermittentForce(HiddenBodyForce):
    """``force`` at the centre of mass inside ``windows``, with flanks of 4 ms."""

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        for start, end in self.vector("windows"):
            if start <= t <= end:
                flank = min((t - start) / 0.004, (end - t) / 0.004, 1.0)
                plant.data.xfrc_applied[self._body, :3] += flank * self._force


class HiddenDrag(WorldLaw):
    """−coefficient·|v|·v at the centre of mass in still air."""

    def bind(self, plant: Plant) -> None:
        """Look up the body."""
        self._body, self._twist = plant.body(self.place), np.zeros(6)

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(plant.model, plant.data, kind, self._body, self._twist, 0)
        v = self._twist[3:]
        plant.data.xfrc_applied[self._body, :3] -= self.number("coefficient") * math.hypot(*v) * v


class HiddenTether(WorldLaw):
    """A spring of no length from the body's frame origin to ``anchor`` in the world."""

    def bind(self, plant: Plant) -> None:
        """Look up the body."""
        self._body, self._anchor = plant.body(self.place), self.vector("anchor")

    def act(self, plant: Plant, t: float) -> None:
        """stiffness·(anchor − origin), moved to the centre of mass with its moment."""
        origin = plant.data.xpos[self._body]
        pull = self.number("stiffness") * (self._anchor - origin)
        wrench = plant.data.xfrc_applied[self._body]
        wrench[:3] += pull
        wrench[3:] += np.cross(origin - plant.data.xipos[self._body], pull)


class HiddenGravity(WorldLaw):
    """Gravity leans by ``angle`` towards azimuth ``direction`` in the world's xy plane."""

    def bind(self, plant: Plant) -> None:
        """g·(sin a·cos d, sin a·sin d, −cos a)."""
        a, d = self.number("angle"), self.number("direction")
        lean = np.array([math.sin(a) * math.cos(d), math.sin(a) * math.sin(d), -math.cos(a)])
        plant.model.opt.gravity[:] = np.linalg.norm(plant.model.opt.gravity) * lean


class HiddenFlywheel(WorldLaw):
    """Outsider: a wheel spinning in the body with momentum ``momentum`` [N·m·s] about ``axis``."""

    def bind(self, plant: Plant) -> None:
        """Look up the body."""
        self._body, self._twist = plant.body(self.place), np.zeros(6)
        self._spin = self.number("momentum") * self.vector("axis")

    def act(self, plant: Plant, t: float) -> None:
        """Moment of the wheel on the body: −ω × L."""
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(plant.model, plant.data, kind, self._body, self._twist, 0)
        spin = plant.data.xmat[self._body].reshape(3, 3) @ self._spin
        plant.data.xfrc_applied[self._body, 3:] -= np.cross(self._twist[:3], spin)


class HiddenCable(WorldLaw):
    """Outsider: a cable over two joints that pulls when ratio·q_a + q_b exceeds ``slack``.

    Tension stiffness·softplus(stretch) on a unit radius, rounded over 0.05 rad.
    """

    def bind(self, plant: Plant) -> None:
        """Look up the joints."""
        self._a, self._b = (plant.index(name) for name in self.place.split("+"))

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        ratio = self.number("ratio")
        q = plant.data.qpos[plant.q_at]
        s = (ratio * float(q[self._a]) + float(q[self._b]) - self.number("slack")) / 0.05
        stretch = 0.05 * (s if s > 30 else math.log1p(math.exp(s)))
        pull = self.number("stiffness") * stretch
        plant.total[self._a] -= pull * ratio
        plant.total[self._b] -= pull


class HiddenBelt(WorldLaw):
    """A belt over two joints: energy ½·stiffness·(q_a + ratio·q_b − reference)²."""

    def bind(self, plant: Plant) -> None:
        """Look up the joints."""
        self._a, self._b = (plant.index(name) for name in self.place.split("+"))

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        ratio, q = self.number("ratio"), plant.data.qpos[plant.q_at]
        length = float(q[self._a]) + ratio * float(q[self._b])
        pull = self.number("stiffness") * (length - self.number("reference"))
        plant.total[self._a] -= pull
        plant.total[self._b] -= ratio * pull


class HiddenCrosstalk(WorldLaw):
    """At a+b ``fraction`` of what the drive of a transmits turns joint b as well."""

    def bind(self, plant: Plant) -> None:
        """Look up the joints."""
        self._a, self._b = (plant.index(name) for name in self.place.split("+"))

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        plant.total[self._b] += self.number("fraction") * float(plant.transmitted[self._a])


class HiddenCounterweight(WorldLaw):
    """A force upwards on every link, ``share`` of its weight."""

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        up = -self.number("share") * plant.model.opt.gravity
        plant.data.xfrc_applied[1:, :3] += plant.model.body_mass[1:, None] * up


class HiddenNudges(WorldLaw):
    """``count`` pushes at a joint, Gaussian in time, of about ``torque`` and either sign.

    In each recording they come at times of its own.
    """

    def bind(self, plant: Plant) -> None:
        """Look up the joint."""
        self._joint, self._nudges = plant.index(self.place), np.zeros((0, 3))

    def start(self) -> None:
        """Draw middles [s], deviations [s] and heights [N·m], two seconds apart in the mean."""
        count = round(self.number("count"))
        middles = 1.0 + 12.0 * (np.arange(count) + self.rng.uniform(0.2, 0.8, count)) / count
        heights = self.number("torque") * self.rng.uniform(0.7, 1.3, count)
        heights *= self.rng.choice([-1.0, 1.0], count)
        self._nudges = np.stack([middles, self.rng.uniform(0.03, 0.1, count), heights], axis=1)

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        middle, deviation, height = self._nudges.T
        course = height * np.exp(-0.5 * ((t - middle) / deviation) ** 2)
        plant.total[self._joint] += float(course.sum())


class HiddenUnbalance(WorldLaw):
    """Outsider: an unbalanced rotor at its own pace: torque·sin(frequency·t + phase) on a joint."""

    def bind(self, plant: Plant) -> None:
        """Look up the joint."""
        self._joint = plant.index(self.place)

    def act(self, plant: Plant, t: float) -> None:
        """See the class."""
        angle = self.number("frequency") * t + self.number("phase")
        plant.total[self._joint] += self.number("torque") * math.sin(angle)


LAWS: dict[str, type[HiddenLaw]] = {
    "body.mass": HiddenMass,
    "body.com": HiddenComShift,
    "body.inertia": HiddenInertia,
    "body.payload_fixed": HiddenPayload,
    "body.force": HiddenBodyForce,
    "body.force_intermittent": HiddenIntermittentForce,
    "body.drag": HiddenDrag,
    "body.tether": HiddenTether,
    "world.gravity": HiddenGravity,
    "world.gravity_compensation": HiddenCounterweight,
    "pair.spring": HiddenBelt,
    "pair.crosstalk": HiddenCrosstalk,
    "joint.force_intermittent": HiddenNudges,
    "outsider.flywheel": HiddenFlywheel,
    "outsider.cable": HiddenCable,
    "outsider.unbalance": HiddenUnbalance,
}
