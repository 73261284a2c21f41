"""The specifications of the set ``legged``: robots on legs, and arms with what they have in common.

They keep their places: new ones are appended to the end of :func:`legged`.
"""

from __future__ import annotations

from wt.prove.case_spec import LEVELS, CaseSpec, Decoy

_QUADRUPED = (
    ("body.payload_fixed", 4), ("body.payload_moving", 8), ("body.force_intermittent", 4),
    ("body.tether", 3), ("body.drag", 2), ("body.force", 1), ("body.mass", 3), ("body.com", 3),
    ("contact.friction", 6), ("contact.compliance", 3), ("contact.slope", 3),
    ("joint.friction_coulomb", 2), ("joint.friction_viscous", 2), ("joint.friction_load", 1),
    ("joint.friction_stribeck", 1), ("joint.backlash", 2), ("joint.elasticity", 1),
    ("joint.hysteresis", 1), ("joint.stop", 1), ("joint.armature", 1), ("joint.stiffness", 1),
    ("actuator.gain", 2), ("actuator.delay", 2), ("actuator.lag", 1), ("actuator.fade", 1),
    ("actuator.bias", 1), ("actuator.saturation", 1),
)  # fmt: skip
_HUMANOID = (
    ("body.payload_fixed", 3), ("body.payload_moving", 4), ("body.force_intermittent", 3),
    ("body.tether", 2), ("body.drag", 1), ("body.mass", 2), ("body.com", 2),
    ("contact.friction", 2), ("contact.compliance", 2), ("contact.slope", 2),
    ("joint.friction_coulomb", 2), ("joint.friction_viscous", 1), ("joint.friction_load", 1),
    ("joint.backlash", 2), ("joint.elasticity", 1), ("joint.hysteresis", 1), ("joint.stop", 1),
    ("actuator.gain", 2), ("actuator.delay", 1), ("actuator.fade", 1),
)  # fmt: skip
_ARMS = (
    *(("body.payload_moving", rig) for rig in ("arm6", "arm3") * 4),
    *(("contact.obstacle", rig) for rig in ("arm6", "arm3") * 4),
)
_PAIRS = (
    ("body.payload_fixed", "joint.friction_coulomb"), ("body.payload_moving", "joint.backlash"),
    ("contact.slope", "actuator.gain"), ("body.force_intermittent", "joint.friction_viscous"),
    ("contact.friction", "body.payload_fixed"), ("body.com", "actuator.delay"),
)  # fmt: skip
_OUTSIDERS = (
    "outsider.sticky_foot", "outsider.loose_pad", "outsider.trailing_cable", "outsider.flywheel",
    "outsider.detent", "outsider.strap", "outsider.sticky_foot", "outsider.loose_pad",
    "outsider.trailing_cable", "outsider.tight_spot",
)  # fmt: skip
_ON_HUMANOID = ("outsider.flywheel", "outsider.strap")
_NULLS = {"quadruped": 20, "humanoid": 14}
_DECOYS: tuple[Decoy, ...] = ("", "", "coarse_step", "", "coloured_noise")


def legged() -> list[CaseSpec]:
    """All specifications, in order."""
    specs: list[CaseSpec] = []
    for rig, effects in (("quadruped", _QUADRUPED), ("humanoid", _HUMANOID)):
        for i, (effect, count) in enumerate(effects):
            specs += [CaseSpec((effect,), rig, LEVELS[(i + k) % 3], "single") for k in range(count)]
    specs += [
        CaseSpec((effect,), rig, LEVELS[i % 3], "single") for i, (effect, rig) in enumerate(_ARMS)
    ]
    specs += [
        CaseSpec(pair, rig, "obvious", "pair")
        for i, pair in enumerate(_PAIRS)
        for rig in (("quadruped", "humanoid") if i % 3 == 0 else ("quadruped",))
    ]
    specs += [
        CaseSpec((effect,), "quadruped", "obvious" if i % 2 else "clear", "outsider")
        for i, effect in enumerate(_OUTSIDERS)
    ]
    specs += [CaseSpec((effect,), "humanoid", "obvious", "outsider") for effect in _ON_HUMANOID]
    for rig, count in _NULLS.items():
        specs += [CaseSpec((), rig, "", "null", _DECOYS[i % len(_DECOYS)]) for i in range(count)]
    return specs
