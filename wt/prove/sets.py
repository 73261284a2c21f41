"""The sets of the trials: effects, rigs and levels that their cases are drawn from.

Specifications keep their places: a new one is appended to :func:`_more`, so that earlier cases keep
their names and seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

from wt.errors import ConfigError
from wt.prove.case_spec import LEVELS, CaseSpec
from wt.prove.case_spec import Decoy as Decoy
from wt.prove.catalog import LIBRARY, OUTSIDERS
from wt.prove.legged_sets import legged
from wt.prove.places import places

SetName = Literal[
    "brief", "quick", "full", "nulls", "singles", "pairs", "triples", "outsiders", "faintest",
    "legged", "ask", "fleet",
]  # fmt: skip

BELOW = "below"
"""The level of effects that drown in the noise."""
ARMS = ("arm6", "arm3", "pendulum", "arm6", "arm3_motor", "arm3")

_SLOW = ("actuator.fade",)
_ON_MOTOR = (
    "joint.friction_coulomb", "joint.friction_viscous", "joint.stiffness", "joint.armature",
    "joint.hysteresis", "joint.friction_stribeck", "joint.friction_load", "joint.stop",
    "actuator.gain", "actuator.ripple", "actuator.deadband", "actuator.saturation",
    "body.payload_fixed", "body.mass", "sensor.offset",
)  # fmt: skip
_ON_PENDULUM = (*_ON_MOTOR[:8], "joint.friction_quadratic", "joint.backlash", "joint.elasticity",
                "actuator.delay", "actuator.lag", "actuator.bias", "actuator.gain",
                "actuator.ripple", "actuator.speed_limit")  # fmt: skip
_ON_PASSIVE = (
    "joint.friction_coulomb", "joint.friction_viscous", "joint.friction_quadratic",
    "joint.stiffness", "joint.armature", "joint.backlash", "actuator.delay", "actuator.gain",
    "sensor.scale", "body.payload_fixed",
)  # fmt: skip
_BELOW = (
    ("joint.friction_coulomb", "arm6"), ("joint.friction_viscous", "arm3"),
    ("actuator.bias", "arm3"), ("joint.stiffness", "arm6"), ("joint.hysteresis", "arm3"),
    ("sensor.offset", "arm6"), ("actuator.delay", "arm6"), ("joint.friction_coulomb", "pendulum"),
)  # fmt: skip
_LATER = (
    ("joint.friction_directional", "arm3"), ("joint.friction_directional", "pendulum"),
    ("pair.spring", "arm6"), ("pair.spring", "arm3"),
    ("world.gravity_compensation", "arm3"), ("world.gravity_compensation", "arm6"),
    ("pair.crosstalk", "arm3"), ("pair.crosstalk", "arm6"),
    ("joint.force_intermittent", "arm3"), ("joint.force_intermittent", "arm6"),
    ("joint.gear_loss", "pendulum"), ("joint.gear_loss", "arm3"),
    ("joint.gear_loss", "pendulum_motor"), ("joint.gear_loss", "arm6"),
    ("actuator.damping", "arm6"), ("actuator.damping", "arm3"),
    ("actuator.feedforward", "arm6"), ("actuator.feedforward", "arm3"),
    ("actuator.integral", "arm6"), ("actuator.integral", "arm3"), ("actuator.integral", "pendulum"),
    ("actuator.slew_rate", "arm6"), ("actuator.slew_rate", "arm3"),
    ("actuator.profile", "arm3"), ("actuator.profile", "arm6"),
)  # fmt: skip
_PAIRED = (
    ("joint.friction_coulomb", "actuator.gain"), ("joint.friction_viscous", "joint.backlash"),
    ("actuator.delay", "joint.friction_coulomb"), ("body.payload_fixed", "joint.friction_viscous"),
    ("joint.stiffness", "joint.friction_stribeck"), ("actuator.ripple", "joint.armature"),
    ("joint.elasticity", "joint.friction_coulomb"), ("actuator.deadband", "actuator.delay"),
    ("sensor.offset", "joint.friction_coulomb"), ("joint.stop", "joint.friction_viscous"),
    ("body.payload_fixed", "actuator.lag"), ("actuator.saturation", "joint.friction_coulomb"),
)  # fmt: skip
_TRIPLED = (
    ("joint.friction_coulomb", "joint.backlash", "actuator.gain"),
    ("actuator.delay", "joint.stiffness", "joint.friction_viscous"),
    ("body.payload_fixed", "joint.friction_coulomb", "joint.armature"),
    ("joint.friction_stribeck", "actuator.bias", "joint.friction_viscous"),
    ("joint.elasticity", "joint.friction_coulomb", "actuator.ripple"),
    ("sensor.offset", "joint.hysteresis", "joint.friction_viscous"),
    ("actuator.lag", "joint.friction_coulomb", "joint.stiffness"),
    ("joint.stop", "actuator.gain", "joint.friction_viscous"),
)
_ASKED = (
    "actuator.deadband", "joint.backlash", "actuator.bias", "joint.friction_coulomb",
    "joint.friction_stribeck", "joint.friction_load", "body.mass", "body.payload_fixed",
    "actuator.delay", "actuator.lag",
)  # fmt: skip
"""Effects that one slow recording leaves open, each among those it is taken for."""
_DECOYS: tuple[Decoy, ...] = (
    "", "coarse_step", "coloured_noise", "", "tight_servo", "poor_excitation",
)  # fmt: skip
_FIRST_OUTSIDERS = 5
"""Outsiders of the first specifications; later ones have theirs in :func:`_more`."""
_BRIEF = (
    "arm3-joint.friction_coulomb", "pendulum-actuator.delay", "arm3-joint.backlash",
    "arm3_motor-actuator.gain", "pendulum-joint.friction_viscous", "arm2_passive-joint.stiffness",
    "arm3-body.payload_fixed+", "pendulum-outsider.detent", "pendulum-nothing",
    "arm3-coloured_noise",
)  # fmt: skip
"""Labels of the cases of the shortest set, or their beginnings; one case each."""


def specs(set: str) -> list[CaseSpec]:
    """The specifications of a set, in order.

    Raises:
        ConfigError: no such set.
    """
    if set not in get_args(SetName):
        raise ConfigError(f"set of trials '{set}'; allowed: {', '.join(get_args(SetName))}")
    if set in _WHOLE_SETS:
        return _WHOLE_SETS[set]()
    kind = set.removesuffix("s")
    return [spec for spec in _full() if spec.kind == kind]


def _full() -> list[CaseSpec]:
    return _singles() + _pairs() + _outsiders() + _nulls() + _more()


def _quick() -> list[CaseSpec]:
    singles = [spec for spec in _singles() if spec.effects[0] not in _SLOW][::6]
    return singles + _pairs()[::4] + _outsiders()[::3] + _nulls()[::7]


def _brief() -> list[CaseSpec]:
    full = _full()
    return [next(s for s in full if s.label.startswith(label)) for label in _BRIEF]


def _faintest() -> list[CaseSpec]:
    return [spec for spec in _full() if spec.level == BELOW]


def _asked() -> list[CaseSpec]:
    return [
        CaseSpec((effect,), rig, level, "single", asked=True)
        for level in LEVELS[:2]
        for effect in _ASKED
        for rig in ("pendulum", "arm3")
        if places(effect, rig)
    ]


def _singles() -> list[CaseSpec]:
    specs: list[CaseSpec] = []
    for i, effect in enumerate(LIBRARY):
        specs.append(CaseSpec((effect,), "arm6", LEVELS[i % 3], "single"))
        specs.append(CaseSpec((effect,), "arm3", LEVELS[(i + 1) % 3], "single"))
        if effect in _ON_MOTOR:
            specs.append(CaseSpec((effect,), "arm3_motor", LEVELS[(i + 2) % 3], "single"))
        if effect in _ON_PENDULUM:
            rig = "pendulum_motor" if i % 4 == 0 and effect in _ON_MOTOR else "pendulum"
            specs.append(CaseSpec((effect,), rig, LEVELS[(i + 2) % 3], "single"))
    return specs


def _pairs() -> list[CaseSpec]:
    rigs = ("arm6", "arm3")
    return [CaseSpec(pair, rigs[i % 2], "obvious", "pair") for i, pair in enumerate(_PAIRED)]


def _outsiders() -> list[CaseSpec]:
    return _outside(OUTSIDERS[:_FIRST_OUTSIDERS])


def _outside(effects: tuple[str, ...]) -> list[CaseSpec]:
    return [
        CaseSpec((effect,), rig, "obvious" if i % 2 else "clear", "outsider")
        for i, effect in enumerate(effects)
        for rig in ("arm6", "arm3", "pendulum")
        if places(effect, rig)
    ]


def _nulls() -> list[CaseSpec]:
    specs: list[CaseSpec] = []
    for i in range(42):
        decoy, rig = _DECOYS[i % 6], ARMS[(i + i // 6) % 6]
        # a motor has no servo to tighten
        rig = rig.removesuffix("_motor") if decoy == "tight_servo" else rig
        specs.append(CaseSpec((), rig, "", "null", decoy))
    return specs


def _more() -> list[CaseSpec]:
    """Later additions: three at once, a passive joint, below the noise, a mass that is wrong."""
    specs: list[CaseSpec] = [
        CaseSpec(triple, ("arm6", "arm3")[i % 2], LEVELS[i % 2], "triple")
        for i, triple in enumerate(_TRIPLED)
    ]
    specs += [
        CaseSpec((effect,), "arm2_passive", LEVELS[i % 3], "single")
        for i, effect in enumerate(_ON_PASSIVE)
    ]
    specs += [CaseSpec((effect,), rig, BELOW, "single") for effect, rig in _BELOW]
    specs += _outside(OUTSIDERS[_FIRST_OUTSIDERS:])
    specs += [CaseSpec((), rig, "", "null", "wrong_mass") for rig in ("arm6", "arm3") * 3]
    specs += [CaseSpec((), rig, "", "null") for rig in ("arm2_passive", "pendulum_motor") * 2]
    specs += [
        CaseSpec((), rig, "", "null", "coloured_noise") for rig in ("arm2_passive", "arm3_motor")
    ]
    specs += [
        CaseSpec((effect,), rig, LEVELS[i % 3], "single") for i, (effect, rig) in enumerate(_LATER)
    ]
    return specs


_WHOLE_SETS: dict[str, Callable[[], list[CaseSpec]]] = {
    "brief": _brief,
    "quick": _quick,
    "full": _full,
    "faintest": _faintest,
    "legged": legged,
    "ask": _asked,
}
"""Sets that are not one kind of case of the full set."""
