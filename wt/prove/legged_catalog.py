"""Effects on robots with legs: their places, their magnitudes, motions that show them.

Effects on joints and drives have the magnitudes of :mod:`wt.prove.catalog`, by the torques that
these robots' motions have; those of bodies and contacts go by the robot's weight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wt.prove import catalog
from wt.prove.catalog import Draw
from wt.prove.hidden import Parameters
from wt.prove.legged_rigs import FLOOR, LEGGED, QUADRUPED_LEGS, SIDES, Legged

_G = 9.81
_LOADED = {
    "quadruped": tuple(f"{leg}_{name}" for leg in QUADRUPED_LEGS for name in ("hip", "knee")),
    "humanoid": tuple(
        f"{side}_{name}" for side in SIDES
        for name in ("hip_pitch", "knee", "ankle_pitch", "shoulder_roll", "elbow")
    ),
}  # fmt: skip
"""Joints that carry weight, whose gears and drives show."""
_TRUNKS = {"quadruped": ("trunk",), "humanoid": ("pelvis", "torso")}
_ARMS = tuple(f"{side}_forearm" for side in SIDES)
_FEET = {name: tuple(foot.name for foot in rig.feet) for name, rig in LEGGED.items()}
_NEED_LOAD = (
    "joint.friction_load", "joint.backlash", "joint.elasticity", "actuator.gain",
    "actuator.deadband", "actuator.fade", "actuator.saturation", "actuator.bias",
)  # fmt: skip

_Places = dict[str, tuple[str, ...]]
PLACES: dict[str, _Places] = {
    **{effect: _LOADED for effect in _NEED_LOAD},
    "body.payload_fixed": _TRUNKS,
    "body.payload_moving": {"quadruped": ("trunk",), "humanoid": ("torso",)},
    "body.force": _TRUNKS,
    "body.force_intermittent": _TRUNKS,
    "body.tether": _TRUNKS,
    "body.drag": {"quadruped": ("trunk",), "humanoid": _ARMS},
    "body.mass": {
        "quadruped": ("trunk", *(f"{leg}_thigh" for leg in QUADRUPED_LEGS)),
        "humanoid": ("torso", *_ARMS),
    },
    "body.com": {"quadruped": ("trunk",), "humanoid": ("torso",)},
    "contact.friction": {name: (*feet, FLOOR, FLOOR) for name, feet in _FEET.items()},
    "contact.compliance": {name: (*feet, FLOOR, FLOOR) for name, feet in _FEET.items()},
    "contact.slope": {name: (FLOOR,) for name in LEGGED},
    "outsider.sticky_foot": _FEET,
    "outsider.loose_pad": _FEET,
    "outsider.trailing_cable": {"quadruped": ("trunk",)},
    "outsider.flywheel": {"quadruped": ("trunk",), "humanoid": ("torso",)},
}
"""Effect → robot → MJCF names; effects that are left out can be at any joint."""

MOTIONS: dict[str, dict[str, tuple[str, str]]] = {
    "contact.friction": {"quadruped": ("trot", "twist"), "humanoid": ("twist", "sway")},
    "contact.compliance": {"quadruped": ("trot", "squat"), "humanoid": ("squat", "sway")},
    "body.drag": {"quadruped": ("trot", "sway"), "humanoid": ("swing", "twist")},
    "outsider.sticky_foot": {"quadruped": ("trot", "paw")},
    "outsider.loose_pad": {"quadruped": ("trot", "walk")},
    "outsider.trailing_cable": {"quadruped": ("trot", "sway")},
}
"""Motions that show an effect; others get one on the spot and one with steps, or two."""


@dataclass(frozen=True)
class LeggedDraw(Draw):
    """Inputs of a magnitude; ``joint`` is meaningless for trunk and feet.

    Attributes:
        place: MJCF name of the place of the effect.
    """

    place: str = ""

    @property
    def robot(self) -> Legged:
        """The robot."""
        assert isinstance(self.rig, Legged)
        return self.rig

    @property
    def weight(self) -> float:
        """Of the robot [N]."""
        return _G * float(mass(self.robot))

    @property
    def on_trunk(self) -> bool:
        """True if the place is a heavy body in the middle."""
        return self.place in _TRUNKS[self.rig.name]

    def sideways(self, size: float) -> list[float]:
        """A vector of a length, more level than not."""
        v = self.rng.normal(size=3) * np.array([1.0, 1.0, 0.3])
        return [float(size * x) for x in v / np.linalg.norm(v)]


def mass(rig: Legged) -> float:
    """Of the whole robot [kg]."""
    return rig.mass + sum(link.mass for link in rig.links)


def _payload(d: LeggedDraw) -> Parameters:
    reach = np.array(d.robot.box) * np.array([0.7, 0.7, 1.0]) if d.on_trunk else np.full(3, 0.03)
    low = np.array([-1.0, -1.0, 0.6])
    at = d.rng.uniform(low, 1.0) * reach + (0.02 if d.on_trunk else 0.0)
    if d.place == "torso":
        at = d.rng.uniform([-0.12, -0.12, 0.05], [0.12, 0.12, 0.3])
    # a humanoid stands on less, and is higher
    heavy = (0.2, 0.1, 0.05) if d.rig.name == "quadruped" else (0.12, 0.07, 0.04)
    share = d.pick(*heavy) if d.on_trunk else d.pick(0.04, 0.02, 0.012)
    return {"mass": share * mass(d.robot), "position": [round(float(x), 4) for x in at]}


def _moving(d: LeggedDraw) -> Parameters:
    at = _payload(d)["position"]
    assert isinstance(at, list)
    on_back = [0.0, 0.0, d.robot.box[2] + 0.07] if d.place != "torso" else [-0.12, 0.0, 0.18]
    share = d.pick(0.28, 0.17, 0.1) * (1.0 if d.rig.name == "quadruped" else 0.35)
    parameters = catalog.moving(d, share * mass(d.robot), d.pick(0.2, 0.14, 0.09))
    return parameters | {
        "position": [round(0.3 * x + y, 4) for x, y in zip(at, on_back, strict=True)]
    }


def _push(d: LeggedDraw) -> Parameters:
    # a humanoid has half the foot to stand on, and is three times as high
    share = d.pick(0.2, 0.12, 0.06) if d.rig.name == "quadruped" else d.pick(0.06, 0.035, 0.02)
    windows = catalog.MAGNITUDES["body.force_intermittent"](d)["windows"]
    return {"force": d.sideways(share * d.weight), "windows": windows}


def _tether(d: LeggedDraw) -> Parameters:
    up = (0.5, 0.9) if d.rig.name == "quadruped" else (1.1, 1.6)
    anchor = [d.sign() * d.u(0.15, 0.5), d.u(-0.4, 0.4), d.u(*up)]
    return {"stiffness": d.pick(40.0, 20.0, 10.0), "anchor": [round(x, 3) for x in anchor]}


def _slope(d: LeggedDraw) -> Parameters:
    steep = d.pick(0.08, 0.045, 0.022) if d.rig.name == "quadruped" else d.pick(0.05, 0.03, 0.018)
    return {"angle": steep, "direction": d.u(-3.1, 3.1)}


MAGNITUDES: dict[str, Callable[[LeggedDraw], Parameters]] = {
    "body.payload_fixed": _payload,
    "body.payload_moving": _moving,
    "body.force": lambda d: {"force": d.sideways(
        d.weight * (d.pick(0.12, 0.07, 0.04) if d.rig.name == "quadruped" else d.pick(
            0.04, 0.025, 0.015)))},
    "body.force_intermittent": _push,
    "body.tether": _tether,
    "body.drag": lambda d: {"coefficient": (
        d.pick(150.0, 75.0, 40.0) if d.on_trunk else d.pick(16.0, 8.0, 4.0))},
    "body.mass": lambda d: {"factor": 1.0 + (
        d.pick(0.4, 0.25, 0.15) if d.on_trunk else d.pick(0.8, 0.5, 0.3))},
    "body.com": lambda d: {"shift": d.sideways(d.pick(0.05, 0.03, 0.018))},
    # a humanoid that never steps asks little of its feet
    "contact.friction": lambda d: {"friction": d.pick(0.12, 0.19, 0.27) * (
        1.0 if d.rig.name == "quadruped" else 0.5)},
    "contact.compliance": lambda d: {"time_constant": d.pick(0.07, 0.05, 0.035)},
    "contact.slope": _slope,
    "outsider.sticky_foot": lambda d: {
        "pull": d.pick(0.35, 0.25, 0.15) * d.weight, "reach": d.u(0.003, 0.006)},
    "outsider.loose_pad": lambda d: {"gap": d.pick(0.012, 0.008, 0.005)},
    "outsider.trailing_cable": lambda d: {
        "level": d.pick(0.08, 0.05, 0.03) * d.weight, "more": d.u(2.0, 6.0)},
    "outsider.flywheel": lambda d: {
        "momentum": d.pick(3.0, 1.8, 1.0), "axis": d.direction()},
}  # fmt: skip


def places(effect: str, rig: str) -> tuple[str, ...]:
    """MJCF names at which an effect is hidden on a robot: of joints, bodies or geoms."""
    return PLACES[effect][rig] if effect in PLACES else LEGGED[rig].joints


def parameters(
    effect: str, rig: str, place: str, level: str, noise: float, seed: int
) -> Parameters:
    """Magnitudes of an effect at a place.

    Args:
        effect: its id, or its law's name.
        rig: the robot's name.
        place: one of :func:`places`.
        level: size in a word, one of ``SHARE``.
        noise: rms position noise of the encoders [rad].
        seed: decides the rest.
    """
    robot = LEGGED[rig]
    joint = robot.joints.index(place) if place in robot.joints else 0
    draw = LeggedDraw(robot, joint, level, noise, np.random.default_rng(seed), place)
    if effect in MAGNITUDES:
        return MAGNITUDES[effect](draw)
    return catalog.MAGNITUDES[effect](draw)
