"""Laws at joints: the ``joint.*`` effects except for the gear, and outsiders of no list."""

from __future__ import annotations

import math

import numpy as np

from wt.prove.hidden import HiddenLaw, JointLaw, Plant


class _HiddenBristle(JointLaw):
    """LuGre friction: ż = v − σ₀|v|z/g, torque −σ₀z − σ₁ż, g the level of sliding friction.

    The bristle's stiffness σ₀ and damping σ₁ are the world's secret: σ₀ lets the joint creep by
    0.1 to 0.5 mrad before it slides, σ₁ damps that creep and vanishes in sliding.
    """

    def bind(self, plant: Plant) -> None:
        """Bristles from the inertia at the joint."""
        inertia = plant.inertia(plant.index(self.place))
        creep = float(self.rng.uniform(1e-4, 5e-4))
        self._s0 = min(self.typical() / creep, 0.1 * inertia / plant.h**2)
        self._s1 = 0.6 * math.sqrt(self._s0 * inertia)
        self._h, self._z = plant.h, 0.0

    def typical(self) -> float:
        """Level that sets the bristle's stiffness [N·m]."""
        return self.number("coulomb")

    def level(self, q: float, v: float, drive: float) -> float:
        """Sliding friction g > 0 [N·m]."""
        return self.number("coulomb")

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class; z implicit, so that any speed is stable."""
        shed = self._s0 * abs(v) / self.level(q, v, drive)
        z = (self._z + self._h * v) / (1.0 + self._h * shed)
        rate = (z - self._z) / self._h
        self._z = z
        return -self._s0 * z - self._s1 * rate


class HiddenCoulombFriction(_HiddenBristle):
    """Dry friction of level ``coulomb`` added to the joint."""


class HiddenStribeckFriction(_HiddenBristle):
    """g = coulomb + (static − coulomb)·exp(−(v/velocity)²)."""

    def level(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        fc, fs = self.number("coulomb"), self.number("static")
        return fc + (fs - fc) * math.exp(-((v / self.number("velocity")) ** 2))


class HiddenLoadFriction(_HiddenBristle):
    """g = coulomb + fraction·|torque transmitted by the drive|."""

    def typical(self) -> float:
        """The part without load, doubled."""
        return 2.0 * self.number("coulomb")

    def level(self, q: float, v: float, drive: float) -> float:
        """See the class, |x| rounded over a hundredth of the constant part."""
        fc = self.number("coulomb")
        return fc + self.number("fraction") * math.hypot(drive, 0.01 * fc)


class HiddenGearLoss(_HiddenBristle):
    """g = coulomb + viscous·|v| + what a gear loses, a share of the torque τ that drives it.

    The share is ``drive`` while the motor turns the load, power flowing with τ·v > 0, and ``back``
    while the load turns the motor.
    """

    def bind(self, plant: Plant) -> None:
        """See the base; the bristle bears the losses under the weight that the joint holds."""
        middle = np.array([[link.middle for link in plant.rig.links]])
        self._held = float(plant.gravity_torques(middle)[0, plant.index(self.place)])
        super().bind(plant)

    def typical(self) -> float:
        """Friction and losses at rest."""
        return self.level(0.0, 0.0, self._held)

    def level(self, q: float, v: float, drive: float) -> float:
        """See the class, |x| rounded over a hundredth of the constant part."""
        fc, share = self.number("coulomb"), self.number("drive" if v * drive >= 0.0 else "back")
        return fc + self.number("viscous") * abs(v) + share * math.hypot(drive, 0.01 * fc)


class HiddenDirectedFriction(_HiddenBristle):
    """g = coulomb + viscous·|v|, both with a value for each direction."""

    def typical(self) -> float:
        """The smaller of both at rest."""
        return min(self.number("coulomb_forward"), self.number("coulomb_backward"))

    def level(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        way = "forward" if v > 0.0 else "backward"
        return self.number(f"coulomb_{way}") + self.number(f"viscous_{way}") * abs(v)


class HiddenViscousFriction(JointLaw):
    """−coefficient·v."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        return -self.number("coefficient") * v


class HiddenQuadraticFriction(JointLaw):
    """−coefficient·v·|v|."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        return -self.number("coefficient") * v * abs(v)


class HiddenStiffness(JointLaw):
    """−stiffness·(q − reference)."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        return -self.number("stiffness") * (q - self.number("reference"))


class HiddenArmature(JointLaw):
    """A heavier rotor: ``inertia`` added to the joint's own."""

    def bind(self, plant: Plant) -> None:
        """Part of the mass matrix."""
        plant.model.dof_armature[plant.dof(self.place)] += self.number("inertia")


class HiddenHysteresis(JointLaw):
    """Bouc–Wen: ż = stiffness·v·(1 − ½(1 + sign(v·z))·|z/yield|⁴), torque −z.

    Elastic with ``stiffness`` after every reversal, and flowing at ``yield``.
    """

    def bind(self, plant: Plant) -> None:
        """At rest, relaxed."""
        self._h, self._z = plant.h, 0.0

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        loading = v * self._z > 0
        flow = 1.0 - (self._z / self.number("yield")) ** 4 if loading else 1.0
        self._z += self._h * self.number("stiffness") * v * flow
        return -self._z


class HiddenStop(JointLaw):
    """A stiff buffer beyond ``position`` on ``side`` (+1: q cannot exceed it), Hunt–Crossley."""

    fine = True

    def bind(self, plant: Plant) -> None:
        """As stiff as the steps allow, at most 30 kN·m/rad."""
        inertia = plant.inertia(plant.index(self.place))
        self._k = min(0.05 * inertia / plant.h**2, 3e4)

    def joint(self, q: float, v: float, drive: float) -> float:
        """depth·k·(1 + 1.2·closing speed), and never pulling."""
        side = self.number("side")
        depth = side * (q - self.number("position"))
        if depth <= 0:
            return 0.0
        return -side * self._k * depth * max(1.0 + 1.2 * side * v, 0.0)


class HiddenDetent(JointLaw):
    """Outsider: a magnet that pulls towards ``angle``, at most ``torque`` at ``width`` from it."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """−torque·s·exp(½(1 − s²)), s = (q − angle)/width."""
        s = (q - self.number("angle")) / self.number("width")
        return -self.number("torque") * s * math.exp(0.5 * (1.0 - s * s))


class HiddenEddyBrake(JointLaw):
    """Outsider: an eddy-current brake, viscous, around ``angle`` over ``width`` only."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """−coefficient·v between smooth edges."""
        s = (abs(q - self.number("angle")) - 0.5 * self.number("width")) / 0.04
        return -self.number("coefficient") * v / (1.0 + math.exp(min(s, 50.0)))


class HiddenTightSpot(_HiddenBristle):
    """Outsider: dry friction that rises to ``coulomb`` at ``angle``, a bell of ``width``."""

    def level(self, q: float, v: float, drive: float) -> float:
        """Never quite zero."""
        s = (q - self.number("angle")) / self.number("width")
        return self.number("coulomb") * (1e-3 + math.exp(-0.5 * s * s))


class HiddenRubber(JointLaw):
    """Outsider: a buffer of rubber, a spring that hardens: −stiffness·(q − reference)³."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        return -self.number("stiffness") * (q - self.number("reference")) ** 3


class HiddenStrap(JointLaw):
    """Outsider: a strap that creeps (Maxwell): ż = v − z/time_constant, torque −stiffness·z."""

    def bind(self, plant: Plant) -> None:
        """Slack; the decay over one step is exact."""
        self._z, self._h = 0.0, plant.h
        self._keep = math.exp(-plant.h / self.number("time_constant"))

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class."""
        tau = self.number("time_constant")
        self._z = self._keep * self._z + (1.0 - self._keep) * tau * v
        return -self.number("stiffness") * self._z


class HiddenJointSlosh(JointLaw):
    """Outsider: a liquid that swings along, a rotor on a spring: natural ``frequency`` [rad/s].

    inertia·ẍ = −k·(x − q) − c·(ẋ − v) with k = inertia·frequency², c = 2·damping·inertia·frequency;
    the joint feels the opposite.
    """

    def bind(self, plant: Plant) -> None:
        """Starts where the joint is, when that is known."""
        self._h, self._x, self._rate = plant.h, math.nan, 0.0

    def joint(self, q: float, v: float, drive: float) -> float:
        """See the class; semi-implicit."""
        if math.isnan(self._x):
            self._x = q
        w = self.number("frequency")
        pull = w * w * (self._x - q) + 2.0 * self.number("damping") * w * (self._rate - v)
        self._rate -= self._h * pull
        self._x += self._h * self._rate
        return self.number("inertia") * pull


LAWS: dict[str, type[HiddenLaw]] = {
    "joint.friction_coulomb": HiddenCoulombFriction,
    "joint.friction_stribeck": HiddenStribeckFriction,
    "joint.friction_load": HiddenLoadFriction,
    "joint.friction_directional": HiddenDirectedFriction,
    "joint.gear_loss": HiddenGearLoss,
    "joint.friction_viscous": HiddenViscousFriction,
    "joint.friction_quadratic": HiddenQuadraticFriction,
    "joint.stiffness": HiddenStiffness,
    "joint.armature": HiddenArmature,
    "joint.hysteresis": HiddenHysteresis,
    "joint.stop": HiddenStop,
    "outsider.detent": HiddenDetent,
    "outsider.eddy_brake": HiddenEddyBrake,
    "outsider.tight_spot": HiddenTightSpot,
    "outsider.rubber": HiddenRubber,
    "outsider.strap": HiddenStrap,
    "outsider.slosh": HiddenJointSlosh,
}
