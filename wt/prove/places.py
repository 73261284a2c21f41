"""For every effect: places that set it apart from its neighbours, and motions that show it."""

from __future__ import annotations

from wt.prove.rigs import RIGS

# Joints (indices, per rig family) where an effect stands apart from its neighbours. Nothing that a
# vertical first axis cannot feel: offsets and biases there shift a position that nothing else
# depends on, and mass there is armature. Gears need a link much heavier than the encoder's step.
_ALL = {"pendulum": (0,), "arm3": (0, 1, 2), "arm6": (0, 1, 2, 3, 4, 5), "arm2_passive": (0, 1)}
_GRAVITY = {"pendulum": (0,), "arm3": (1, 2), "arm6": (1, 2, 4), "arm2_passive": (0,)}
_LOADED = {"pendulum": (0,), "arm3": (1, 2), "arm6": (1, 2)}
_GEARED = {"pendulum": (0,), "arm3": (0, 1, 2), "arm6": (0, 1, 2, 4), "arm2_passive": (0,)}
_BODIES = {"arm3": (1, 2), "arm6": (1, 2, 4)}
_ENDS = {"arm3": (2,), "arm6": (2, 4, 5), "arm2_passive": (1,)}
_PAIRS = {"arm3": (2,), "arm6": (2, 4)}

PLACES: dict[str, dict[str, tuple[int, ...]]] = {
    "joint.friction_load": _LOADED,
    "joint.gear_loss": _LOADED,
    "joint.backlash": _GEARED,
    "joint.elasticity": _GEARED,
    "actuator.integral": _GRAVITY,
    "actuator.bias": _GRAVITY,
    "actuator.gain": _GRAVITY,
    "actuator.deadband": _GRAVITY,
    "actuator.fade": _GRAVITY,
    "sensor.offset": _GRAVITY,
    "body.mass": _BODIES,
    "body.com": _BODIES,
    "body.inertia": {"arm3": (1, 2), "arm6": (1, 2)},
    "body.payload_fixed": _ENDS,
    "body.force": _ENDS,
    "body.force_intermittent": _ENDS,
    "body.drag": _ENDS,
    "body.tether": _ENDS,
    "body.payload_moving": _ENDS,
    "contact.obstacle": {"arm3": (2,), "arm6": (5,)},
    "world.gravity": {"arm3": (1,), "arm6": (1,)},
    "world.gravity_compensation": {"arm3": (1,), "arm6": (1,)},
    "pair.spring": _PAIRS,
    "pair.crosstalk": _PAIRS,
    "outsider.flywheel": {"arm3": (2,), "arm6": (2, 4)},
    "outsider.cable": _PAIRS,
}

MOTIONS: dict[str, tuple[str, str]] = {
    "joint.friction_directional": ("triangle", "multisine"),
    "joint.friction_stribeck": ("triangle", "moves"),
    "joint.friction_load": ("triangle", "multisine"),
    "joint.gear_loss": ("triangle", "multisine"),
    "joint.hysteresis": ("triangle", "multisine"),
    "joint.backlash": ("triangle", "multisine"),
    "joint.friction_quadratic": ("chirp", "multisine"),
    "joint.stop": ("moves", "multisine"),
    "joint.armature": ("multisine", "chirp"),
    "joint.elasticity": ("jumps", "chirp"),
    "actuator.delay": ("jumps", "multisine"),
    "actuator.lag": ("jumps", "multisine"),
    "actuator.slew_rate": ("jumps", "multisine"),
    "actuator.profile": ("jumps", "multisine"),
    "actuator.integral": ("moves", "multisine"),
    "actuator.saturation": ("jumps", "moves"),
    "actuator.speed_limit": ("jumps", "chirp"),
    "actuator.fade": ("multisine", "holds"),
    "body.drag": ("chirp", "multisine"),
    "body.payload_moving": ("moves", "chirp"),
    "contact.obstacle": ("moves", "multisine"),
    "body.inertia": ("multisine", "chirp"),
    "sensor.delay": ("multisine", "jumps"),
}
"""Motions that show an effect; others get two at random. Held out is always another."""


def places(effect: str, rig: str) -> tuple[int, ...]:
    """Joints of a rig (by its name) at which an effect is hidden; empty where it cannot be."""
    joints = PLACES.get(effect, _ALL).get(rig.removesuffix("_motor"), ())
    driven = [link.driven for link in RIGS[rig].links]
    return tuple(j for j in joints if driven[j] or not effect.startswith("actuator."))
