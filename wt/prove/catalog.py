"""For every effect: seeded magnitudes.

Magnitudes are set by the torque (or travel) that they make, in three levels from obvious down to
a few times the noise: the smallest is never below ``FLOOR`` times the position noise expressed
as torque, kp × noise, so that every hidden effect leaves a trace. The fourth level, ``below``, is
for effects that leave none: nobody can find them, and a claim had better be silent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wt.prove.hidden import Parameters
from wt.prove.rigs import RIGS, Rig
from wt.prove.scales import RigScales, scales

SHARE = {"obvious": 0.35, "clear": 0.14, "faint": 0.06}
"""Level → torque of an effect, as a fraction of the joint's rms torque."""
FLOOR = 6.0
DROWNED = 0.3
"""Size of effects of the level ``below``, as a share of the noise."""


@dataclass(frozen=True)
class Draw:
    """Inputs of a magnitude.

    Attributes:
        rig: the robot.
        joint: index of the joint, or of the joint that carries the body.
        level: one of ``SHARE``.
        noise: rms position noise with quantization [rad].
        rng: decides the rest.
    """

    rig: Rig
    joint: int
    level: str
    noise: float
    rng: np.random.Generator

    @property
    def scale(self) -> RigScales:
        """Of the rig."""
        return scales(self.rig.name)

    def of(self, name: str) -> float:
        """One of the scales at the joint."""
        return float(getattr(self.scale, name)[self.joint])

    def u(self, low: float, high: float) -> float:
        """Uniform."""
        return float(self.rng.uniform(low, high))

    def sign(self) -> float:
        """±1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def pick(self, obvious: float, clear: float, faint: float) -> float:
        """The value of the level, ± 15 %."""
        values = {"obvious": obvious, "clear": clear, "faint": faint, "below": faint}
        return values[self.level] * self.u(0.85, 1.15)

    def seen(self, usual: float, noise: float, floor: float = FLOOR) -> float:
        """A size that shows above the noise, or does not, as the level wants."""
        return DROWNED * noise if self.level == "below" else max(usual, floor * noise)

    @property
    def torque(self) -> float:
        """Torque of an effect of this level [N·m]."""
        usual = SHARE.get(self.level, 0.0) * max(self.of("torque"), 0.1 * self.of("peak"))
        return self.seen(usual, self.noise * self.rig.links[self.joint].kp) * self.u(0.9, 1.3)

    @property
    def angle(self) -> float:
        """A position that motions pass often [rad]."""
        return self.u(self.of("low"), self.of("high"))

    def direction(self) -> list[float]:
        """A random unit vector."""
        v = self.rng.normal(size=3)
        return [float(x) for x in v / np.linalg.norm(v)]


Magnitudes = Callable[[Draw], Parameters]


def _stribeck(d: Draw) -> Parameters:
    coulomb = d.torque
    return {"coulomb": coulomb, "static": coulomb * d.u(1.5, 2.2), "velocity": d.u(0.04, 0.12)}


def _viscous(d: Draw) -> Parameters:
    """More than the model has, or less where it has so much."""
    size = 1.5 * d.torque / d.of("speed")
    less = size < 0.9 * d.rig.links[d.joint].damping and d.u(0.0, 1.0) < 0.5
    return {"coefficient": -size if less else size}


def _damping(d: Draw) -> Parameters:
    """Less of it, by as much torque as the level has."""
    kv = d.rig.links[d.joint].kv
    return {"factor": max(0.1, 1.0 - 1.5 * d.torque / (d.of("speed") * kv))}


def _elasticity(d: Draw) -> Parameters:
    twist = d.seen(d.pick(0.02, 0.009, 0.004), d.noise)
    stiff = max(d.of("torque"), 0.15 * d.of("peak")) / twist
    rotor = d.rig.links[d.joint].armature
    return {"stiffness": stiff, "damping": 2 * d.u(0.05, 0.15) * math.sqrt(stiff * rotor)}


def _stop(d: Draw) -> Parameters:
    side, middle = d.sign(), d.rig.links[d.joint].middle
    reach = d.rig.links[d.joint].amplitude * d.pick(0.25, 0.35, 0.45)
    return {"position": middle + side * reach, "side": side}


def _gain(d: Draw) -> Parameters:
    change = min(max(d.pick(0.4, 0.2, 0.1), d.torque / d.of("peak")), 0.6)
    return {"factor": 1.0 + change * (d.sign() if change < 0.3 else -1.0)}


def _delay(d: Draw) -> float:
    return d.seen(d.pick(0.03, 0.014, 0.007), d.noise / d.of("speed"))


def _saturation(d: Draw) -> Parameters:
    low, high = d.of("hold"), d.of("peak")
    return {"torque": low * 1.05 + (high - low) * d.pick(0.15, 0.28, 0.42)}


def _speed_limit(d: Draw) -> Parameters:
    return {"stall": d.of("peak") * d.u(1.0, 1.3), "speed": d.of("dash") * d.pick(0.6, 0.85, 1.1)}


def _fade(d: Draw) -> Parameters:
    return {
        "loss": d.pick(0.4, 0.25, 0.15),
        "time_constant": d.u(3.0, 8.0),
        "rated": d.of("torque"),
    }


def _payload(d: Draw) -> Parameters:
    reach = np.array(d.rig.links[d.joint].to) * d.u(0.5, 1.1)
    aside = d.rng.uniform(-0.06, 0.06, 3)
    return {
        "mass": d.pick(1.2, 0.6, 0.3),
        "position": [round(float(x), 4) for x in reach + aside],
    }


def _moving(d: Draw) -> Parameters:
    fixed, travel = _payload(d), d.pick(0.12, 0.08, 0.05)
    return moving(d, float(fixed["mass"]), travel) | {"position": fixed["position"]}  # type: ignore[arg-type]


def moving(d: Draw, mass: float, travel: float) -> Parameters:
    """A payload that moves, with what each kind of it needs besides mass [kg] and travel [m]."""
    return {
        "mass": mass, "travel": travel, "radius": d.u(0.025, 0.045),
        "breadth": travel * d.u(0.3, 1.0), "damping": mass * d.u(3.0, 8.0),
        "frequency": d.u(5.0, 9.0), "ratio": d.u(0.08, 0.2),
    }  # fmt: skip


def _windows(d: Draw) -> Parameters:
    start, windows = d.u(1.0, 2.0), []
    while start < 13.0:
        end = start + d.u(0.25, 1.2)
        windows.append([round(start, 3), round(end, 3)])
        start = end + d.u(0.8, 3.0)
    return {"force": _scaled(d, d.pick(20.0, 10.0, 5.0)), "windows": windows}


def _scaled(d: Draw, size: float) -> list[float]:
    return [size * x for x in d.direction()]


def _tether(d: Draw) -> Parameters:
    anchor = [d.u(0.1, 0.6), d.u(-0.5, 0.5), d.u(0.0, 0.9)]
    return {"stiffness": d.pick(40.0, 20.0, 9.0), "anchor": [round(x, 3) for x in anchor]}


def _hysteresis(d: Draw) -> Parameters:
    level = 1.3 * d.torque
    return {
        "stiffness": level / (d.u(0.08, 0.25) * d.rig.links[d.joint].amplitude),
        "yield": level,
    }


def _width(d: Draw) -> float:
    return d.u(0.12, 0.25) * d.rig.links[d.joint].amplitude


def _detent(d: Draw) -> Parameters:
    return {"torque": 2.5 * d.torque, "angle": d.angle, "width": _width(d)}


def _eddy(d: Draw) -> Parameters:
    c = 2.5 * d.torque / d.of("speed")
    return {"coefficient": c, "angle": d.angle, "width": 2.5 * _width(d)}


def _cable(d: Draw) -> Parameters:
    a, b = d.rig.links[d.joint - 1], d.rig.links[d.joint]
    ratio = d.sign() * d.u(0.5, 1.5)
    slack = ratio * a.middle + b.middle + d.u(-0.2, 0.1)
    return {"ratio": ratio, "slack": slack, "stiffness": 4.0 * d.torque / b.amplitude}


def _rubber(d: Draw) -> Parameters:
    a = d.rig.links[d.joint].amplitude
    return {"stiffness": 4.0 * d.torque / a**3, "reference": d.rig.links[d.joint].middle}


def _strap(d: Draw) -> Parameters:
    relaxes = d.u(0.15, 0.4)
    return {"stiffness": 3.0 * d.torque / (d.of("speed") * relaxes), "time_constant": relaxes}


def _slosh(d: Draw) -> Parameters:
    inertia = 2.0 * d.torque / d.of("acceleration")
    return {"inertia": inertia, "frequency": d.u(9.0, 16.0), "damping": d.u(0.05, 0.15)}


def _unbalance(d: Draw) -> Parameters:
    return {"torque": 2.0 * d.torque, "frequency": d.u(8.0, 25.0), "phase": d.u(-3.0, 3.0)}


MAGNITUDES: dict[str, Magnitudes] = {
    "joint.friction_coulomb": lambda d: {"coulomb": d.torque},
    "joint.friction_viscous": _viscous,
    "joint.friction_quadratic": lambda d: {"coefficient": 2.0 * d.torque / d.of("speed") ** 2},
    "joint.friction_stribeck": _stribeck,
    "joint.friction_load": lambda d: {
        "coulomb": 0.4 * d.torque, "fraction": d.pick(0.3, 0.18, 0.1),
    },
    "joint.stiffness": lambda d: {
        "stiffness": 3.0 * d.torque / d.rig.links[d.joint].amplitude, "reference": d.angle,
    },
    "joint.armature": lambda d: {"inertia": max(
        d.pick(0.5, 0.25, 0.12) * d.of("inertia"), 1.5 * d.torque / d.of("acceleration")
    )},
    "joint.backlash": lambda d: {"gap": d.seen(d.pick(0.04, 0.018, 0.008), d.noise)},
    "joint.elasticity": _elasticity,
    "joint.hysteresis": _hysteresis,
    "joint.stop": _stop,
    "actuator.gain": _gain,
    "actuator.bias": lambda d: {"torque": d.sign() * d.torque},
    "actuator.delay": lambda d: {"delay": _delay(d)},
    "actuator.lag": lambda d: {"time_constant": 1.3 * _delay(d)},
    "actuator.saturation": _saturation,
    "actuator.speed_limit": _speed_limit,
    "actuator.deadband": lambda d: {"width": d.torque},
    "actuator.ripple": lambda d: {
        "amplitude": d.torque, "cycles": float(d.rng.integers(5, 16)), "phase": d.u(-3.0, 3.0),
    },
    "actuator.fade": _fade,
    "body.mass": lambda d: {"factor": 1.0 + d.pick(0.7, 0.4, 0.2)},
    "body.com": lambda d: {"shift": _scaled(d, d.pick(0.1, 0.06, 0.035))},
    "body.inertia": lambda d: {"factor": d.pick(14.0, 9.0, 6.0)},
    "body.payload_fixed": _payload,
    "body.force": lambda d: {"force": _scaled(d, d.pick(16.0, 8.0, 4.0))},
    "body.force_intermittent": _windows,
    "body.drag": lambda d: {"coefficient": d.pick(40.0, 20.0, 10.0)},
    "body.tether": _tether,
    "sensor.offset": lambda d: {
        "offset": d.sign() * d.seen(d.pick(0.12, 0.06, 0.03), d.noise, 10.0),
    },
    "sensor.scale": lambda d: {"factor": 1.0 + d.sign() * d.pick(0.1, 0.06, 0.03)},
    "sensor.delay": lambda d: {"delay": _delay(d)},
    "sensor.quantization": lambda d: {
        "step": d.seen(d.pick(0.04, 0.02, 0.012), d.noise, 10.0),
    },
    "world.gravity": lambda d: {"angle": d.pick(0.25, 0.12, 0.06), "direction": d.u(-3.1, 3.1)},
    "outsider.detent": _detent,
    "outsider.eddy_brake": _eddy,
    "outsider.tight_spot": lambda d: {
        "coulomb": 2.5 * d.torque, "angle": d.angle, "width": _width(d),
    },
    "outsider.flywheel": lambda d: {"momentum": d.pick(1.6, 0.9, 0.5), "axis": d.direction()},
    "outsider.cable": _cable,
    "outsider.rubber": _rubber,
    "outsider.strap": _strap,
    "outsider.slosh": _slosh,
    "outsider.unbalance": _unbalance,
}  # fmt: skip


def _directed(d: Draw) -> Parameters:
    dry, wet = d.torque, 0.8 * d.torque / d.of("speed")
    more, less = (1.5, 0.6) if d.sign() > 0.0 else (0.6, 1.5)
    return {
        "coulomb_forward": 0.5 * dry, "coulomb_backward": 0.5 * dry,
        "viscous_forward": more * wet, "viscous_backward": less * wet,
    }  # fmt: skip


def _geared(d: Draw) -> Parameters:
    drive = d.u(0.1, 0.25)
    return {
        "drive": drive, "back": drive + d.pick(0.35, 0.22, 0.14),
        "coulomb": 0.25 * d.torque, "viscous": 0.25 * d.torque / d.of("speed"),
    }  # fmt: skip


def _belt(d: Draw) -> Parameters:
    a, b = d.rig.links[d.joint - 1], d.rig.links[d.joint]
    ratio = d.sign() * d.u(0.5, 1.5)
    return {
        "ratio": ratio, "stiffness": 3.0 * d.torque / b.amplitude,
        "reference": a.middle + ratio * b.middle + d.u(-0.2, 0.2),
    }  # fmt: skip


def _integral(d: Draw) -> Parameters:
    """It takes over from the servo's stiffness within one second, or some."""
    return {"ki": d.rig.links[d.joint].kp * d.pick(1.5, 0.6, 0.25)}


def _profile(d: Draw) -> Parameters:
    """A speed that the goal comes to on an ordinary way: else there is none to be told."""
    speed = d.of("dash") * d.pick(0.25, 0.4, 0.55)
    return {"speed": speed, "acceleration": speed / d.u(0.05, 0.15)}


LATER: dict[str, Magnitudes] = {
    "actuator.damping": _damping,
    "actuator.feedforward": lambda d: {"coefficient": 1.5 * d.torque / d.of("speed")},
    "actuator.integral": _integral,
    "actuator.slew_rate": lambda d: {"speed": d.of("dash") * d.pick(0.35, 0.55, 0.8)},
    "actuator.profile": _profile,
    "joint.friction_directional": _directed,
    "joint.gear_loss": _geared,
    "pair.spring": _belt,
    "pair.crosstalk": lambda d: {"fraction": d.sign() * d.pick(0.3, 0.2, 0.1)},
    "joint.force_intermittent": lambda d: {"torque": 4.0 * d.torque, "count": 5},
    "world.gravity_compensation": lambda d: {"share": d.pick(1.0, 0.6, 0.3)},
    "body.payload_moving": _moving,
    # where it can stand depends on the motions
    "contact.obstacle": lambda d: {},
}
"""Effects that are not among the first specifications of arms, see :mod:`wt.prove.sets`."""

LIBRARY = tuple(effect for effect in MAGNITUDES if not effect.startswith("outsider."))
OUTSIDERS = tuple(effect for effect in MAGNITUDES if effect.startswith("outsider."))


def parameters(
    effect: str, rig: str, joint: int, level: str, noise: float, seed: int
) -> Parameters:
    """Magnitudes of an effect at a joint (or its body)."""
    draw = Draw(RIGS[rig], joint, level, noise, np.random.default_rng(seed))
    return (MAGNITUDES | LATER)[effect](draw)
