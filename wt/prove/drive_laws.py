"""Laws between the command and the joint: the ``actuator.*`` effects and the gear.

Definitions of the parameters stand at each law. Limits have smooth knees of 2 %.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from wt.prove.hidden import CommandLaw, GearLaw, HiddenLaw, Parameters, Plant, TorqueLaw


class HiddenDelay(CommandLaw):
    """The servo gets u(t − delay)."""

    def bind(self, plant: Plant) -> None:
        """Length of the queue: whole steps, and a fraction that is interpolated."""
        steps = self.number("delay") / plant.h
        self._whole, self._part = int(steps), steps - int(steps)
        self._queue: list[float] = []
        self._at = 0

    def command(self, u: float) -> float:
        """One in, one out; full of the first command at the start."""
        size = self._whole + 2
        if not self._queue:
            self._queue = [u] * size
        self._queue[self._at] = u
        late = self._queue[(self._at - self._whole) % size]
        later = self._queue[(self._at - self._whole - 1) % size]
        self._at = (self._at + 1) % size
        return late + self._part * (later - late)


class HiddenLag(CommandLaw):
    """time_constant·ẋ = u − x; the servo gets x."""

    def bind(self, plant: Plant) -> None:
        """Exact decay over one step, during which u is constant."""
        self._keep = math.exp(-plant.h / self.number("time_constant"))
        self._half = math.exp(-0.5 * plant.h / self.number("time_constant"))
        self._x: float | None = None

    def command(self, u: float) -> float:
        """The filter's state in the middle of the step."""
        x = u if self._x is None else self._x
        self._x = u + (x - u) * self._keep
        return u + (x - u) * self._half


class HiddenGain(TorqueLaw):
    """τ → factor·τ."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class."""
        return self.number("factor") * tau


class HiddenDamping(TorqueLaw):
    """−kv·v → −factor·kv·v: what is no longer fed back is pushed."""

    def bind(self, plant: Plant) -> None:
        """The drive's own gain."""
        self._kv = float(plant.kv[plant.index(self.place)])

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class."""
        return tau + (1.0 - self.number("factor")) * self._kv * v


class HiddenFeedforward(CommandLaw):
    """Firmware that adds coefficient·(difference of the last two commands / their distance).

    It is a command that is ahead, for a servo that pushes kp for it.
    """

    def bind(self, plant: Plant) -> None:
        """The servo's stiffness, and how often commands come; none has come yet."""
        self._ahead = self.number("coefficient") / float(plant.kp[plant.index(self.place)])
        self._interval = plant.interval
        self._past = deque[float](maxlen=max(1, round(plant.interval / plant.h)))

    def command(self, u: float) -> float:
        """A command that lasts longer than others was sent again, and has no rate any more."""
        if len(self._past) < (self._past.maxlen or 1):
            self._past.extend([u] * (self._past.maxlen or 1))
        rate = (u - self._past[0]) / self._interval
        self._past.append(u)
        return u + self._ahead * rate


class HiddenIntegral(CommandLaw, TorqueLaw):
    """τ → τ + ki·∫(u − q) dt within the drive's limit; it has begun before the recording does."""

    def bind(self, plant: Plant) -> None:
        """The drive's limit; nothing is summed up yet."""
        self._h, self._limit = plant.h, float(plant.limit[plant.index(self.place)])
        self._goal, self._sum, self._error = 0.0, 0.0, math.nan

    def command(self, u: float) -> float:
        """What the servo is to reach, which it does reach."""
        self._goal = u
        return u

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class; by the trapezoidal rule, up to the step's own time."""
        error = self._goal - q
        before = error if math.isnan(self._error) else self._error
        self._sum += 0.5 * self._h * (before + error)
        self._error = error
        total = tau + self.number("ki") * self._sum
        return min(max(total, -self._limit), self._limit)


class HiddenSlewRate(CommandLaw):
    """The servo gets a goal that moves to the command no faster than ``speed``."""

    def bind(self, plant: Plant) -> None:
        """Way of one step."""
        self._way, self._goal = plant.h * self.number("speed"), math.nan

    def command(self, u: float) -> float:
        """The goal in the middle of the step."""
        begun = u if math.isnan(self._goal) else self._goal
        self._goal = begun + math.copysign(min(self._way, abs(u - begun)), u - begun)
        return 0.5 * (begun + self._goal)


class HiddenProfile(CommandLaw):
    """The servo gets a goal that goes to rest at the command in the shortest time.

    It has no more than ``speed`` and ``acceleration`` then: full acceleration on this side of the
    parabola on which full deceleration leads to the command, and that beyond.
    """

    def bind(self, plant: Plant) -> None:
        """Pick up the step."""
        self._h, self._goal, self._rate = plant.h, math.nan, 0.0

    def command(self, u: float) -> float:
        """The goal in the middle of the step."""
        if math.isnan(self._goal):
            self._goal = u
        h, most = self._h, self.number("acceleration")
        left, rate, before = u - self._goal, self._rate, self._goal
        if abs(rate) <= most * h and abs(left) <= most * h * h:
            self._goal, self._rate = u, 0.0
            return 0.5 * (before + u)
        # where the goal would come to rest if it braked after this step
        short = left - 0.5 * rate * h - rate * abs(rate) / (2.0 * most)
        wanted = rate + math.copysign(most * h, short)
        top = self.number("speed")
        self._rate = min(max(wanted, -top), top)
        self._goal += 0.5 * h * (rate + self._rate)
        return 0.5 * (before + self._goal)


class HiddenBias(TorqueLaw):
    """τ → τ + torque."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class."""
        return tau + self.number("torque")


def knee(x: float, top: float, width: float) -> float:
    """The smaller of x and ``top``, with a smooth knee of ``width``."""
    s = (top - x) / width
    if s > 30.0:
        return x
    # top − width·log(1 + e^s)
    return top - width * (math.log1p(math.exp(s)) if s > -30.0 else 0.0)


class HiddenSaturation(TorqueLaw):
    """|τ| ≤ torque."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class."""
        top = self.number("torque")
        return -knee(-knee(tau, top, 0.02 * top), top, 0.02 * top)


class HiddenSpeedLimit(TorqueLaw):
    """A DC motor at limited voltage: −stall·(1 + v/speed) ≤ τ ≤ stall·(1 − v/speed)."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class."""
        stall, pace = self.number("stall"), v / self.number("speed")
        tau = knee(tau, stall * (1 - pace), 0.02 * stall)
        return -knee(-tau, stall * (1 + pace), 0.02 * stall)


class HiddenDeadband(TorqueLaw):
    """The first ``width`` of torque of either sign is lost: τ → sign(τ)·max(|τ| − width, 0)."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class, with knees of 2 % of the width."""
        width = self.number("width")
        up = tau - knee(tau, width, 0.02 * width)
        return up + (tau - (-knee(-tau, width, 0.02 * width)))


class HiddenRipple(TorqueLaw):
    """τ → τ + amplitude·sin(cycles·q + phase)."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class."""
        angle = self.number("cycles") * q + self.number("phase")
        return tau + self.number("amplitude") * math.sin(angle)


class HiddenFade(TorqueLaw):
    """τ → (1 − loss·x)·τ with heat x: time_constant·ẋ = (τ/rated)² − x, x(0) = 0.

    ``rated`` is the joint's root mean square torque in ordinary motion, at which x goes to 1.
    """

    def bind(self, plant: Plant) -> None:
        """Pick up the step."""
        self._h, self._heat = plant.h, 0.0

    def start(self) -> None:
        """Cold."""
        self._heat = 0.0

    def torque(self, tau: float, q: float, v: float) -> float:
        """See the class; heat is bounded, as a motor's thermal protection would."""
        power = min((tau / self.number("rated")) ** 2, 8.0)
        self._heat += self._h / self.number("time_constant") * (power - self._heat)
        return (1.0 - self.number("loss") * min(self._heat, 1.5)) * tau


class _HiddenGear(GearLaw):
    """A rotor with the joint's armature, turning in smaller steps than the rest of the world."""

    fine = True
    SUBSTEPS = 4

    def bind(self, plant: Plant) -> None:
        """Move the armature from the joint to the rotor."""
        joint = plant.index(self.place)
        dof = plant.dof(self.place)
        self.rotor = float(plant.model.dof_armature[dof])
        plant.model.dof_armature[dof] = 0.0
        self.link = plant.inertia(joint)
        self.h = plant.h / self.SUBSTEPS
        self.angle, self.rate = 0.0, 0.0

    def advance(self, tau: float, q: float, v: float) -> float:
        """Semi-implicit steps of the rotor while the joint moves on at v; mean gear torque."""
        total = 0.0
        for k in range(self.SUBSTEPS):
            passed = self.mesh(self.angle - q - v * k * self.h, self.rate - v)
            self.rate += self.h * (tau - passed) / self.rotor
            self.angle += self.h * self.rate
            total += passed
        return total / self.SUBSTEPS

    def mesh(self, twist: float, rate: float) -> float:
        """Torque through the gear [N·m] at a twist [rad] and its rate."""
        raise AssertionError("a gear overrides this")


class HiddenBacklash(_HiddenGear):
    """Nothing is passed while |twist| < gap/2; beyond, stiff teeth."""

    def bind(self, plant: Plant) -> None:
        """Teeth as stiff as the steps allow."""
        super().bind(plant)
        stiff = min(self.rotor * (0.25 / self.h) ** 2, 0.1 * self.link / plant.h**2)
        reduced = self.rotor * self.link / (self.rotor + self.link)
        self._k, self._c = stiff, 0.8 * math.sqrt(stiff * reduced)
        self._half = 0.5 * self.number("gap")

    def mesh(self, twist: float, rate: float) -> float:
        """Teeth push and never pull."""
        if twist > self._half:
            return max(self._k * (twist - self._half) + self._c * rate, 0.0)
        if twist < -self._half:
            return min(self._k * (twist + self._half) + self._c * rate, 0.0)
        return 0.0


class HiddenElasticity(_HiddenGear):
    """stiffness·twist + damping·rate."""

    def mesh(self, twist: float, rate: float) -> float:
        """See the class."""
        return self.number("stiffness") * twist + self.number("damping") * rate


LAWS: dict[str, type[HiddenLaw]] = {
    "actuator.delay": HiddenDelay,
    "actuator.lag": HiddenLag,
    "actuator.gain": HiddenGain,
    "actuator.damping": HiddenDamping,
    "actuator.feedforward": HiddenFeedforward,
    "actuator.integral": HiddenIntegral,
    "actuator.slew_rate": HiddenSlewRate,
    "actuator.profile": HiddenProfile,
    "actuator.bias": HiddenBias,
    "actuator.saturation": HiddenSaturation,
    "actuator.speed_limit": HiddenSpeedLimit,
    "actuator.deadband": HiddenDeadband,
    "actuator.ripple": HiddenRipple,
    "actuator.fade": HiddenFade,
    "joint.backlash": HiddenBacklash,
    "joint.elasticity": HiddenElasticity,
}


def make(
    laws: dict[str, type[HiddenLaw]], effect: str, place: str, parameters: Parameters, seed: int
) -> HiddenLaw:
    """The law of an effect."""
    return laws[effect](place, parameters, np.random.default_rng(seed))
