"""Facts that effects declare of themselves: what they look like, how common they are, and so on."""

from __future__ import annotations

from collections import Counter

import pytest

from wt.physics import hooks
from wt.physics.effect import Effect, alternatives, effects
from wt.physics.hooks import Tolerated

# Effects that look alike: any two of a group.
ALIKE = (
    (
        "joint.friction_coulomb", "joint.friction_directional", "joint.friction_load",
        "joint.friction_position", "joint.friction_stribeck", "joint.gear_loss",
    ),
    (
        "actuator.damping", "actuator.feedforward", "joint.friction_viscous",
        "joint.friction_quadratic", "joint.friction_stribeck",
    ),
    ("actuator.delay", "actuator.lag", "actuator.profile", "actuator.slew_rate", "sensor.delay"),
    ("actuator.gain", "actuator.deadband", "actuator.fade", "actuator.saturation"),
    ("joint.stiffness", "joint.hysteresis", "actuator.bias"),
    (
        "actuator.bias", "actuator.deadband", "actuator.gain", "actuator.integral",
        "joint.backlash", "sensor.offset",
    ),
    ("joint.armature", "body.inertia"),
    ("body.force", "body.tether", "world.gravity"),
    ("body.mass", "body.com", "body.payload_fixed", "body.payload_moving"),
)  # fmt: skip
ALWAYS = {
    "joint.friction_coulomb",
    "joint.friction_viscous",
    "actuator.bias",
    "actuator.gain",
    "actuator.delay",
}
OFTEN = {
    "actuator.damping",
    "actuator.feedforward",
    "joint.friction_quadratic",
    "body.payload_fixed",
    "body.mass",
    "body.com",
}
OVER = {
    "velocity": {
        "actuator.damping", "actuator.delay", "actuator.feedforward", "actuator.lag",
        "actuator.profile", "actuator.slew_rate", "actuator.speed_limit",
        "body.drag", "contact.friction",
        "joint.friction_coulomb", "joint.friction_directional", "joint.friction_load",
        "joint.friction_quadratic",
        "joint.friction_stribeck", "joint.friction_viscous", "sensor.delay",
    },
    "acceleration": {"joint.armature", "body.inertia"},
    "drive": {
        "actuator.deadband", "actuator.gain", "actuator.saturation", "joint.backlash",
        "joint.elasticity", "joint.gear_loss", "pair.crosstalk",
    },
    "time": {
        "actuator.fade", "actuator.integral", "body.force_intermittent", "body.payload_moving",
        "joint.force_intermittent",
    },
}  # fmt: skip
OFF = {
    "body.mass", "joint.friction_viscous", "joint.armature", "sensor.delay", "actuator.gain",
    "actuator.delay",
}  # fmt: skip


@pytest.mark.parametrize("name", [*effects(), "unknown"])
def test_alternatives_are_all_that_share_a_group(name: str) -> None:
    together = {other for group in ALIKE if name in group for other in group} - {name}
    assert alternatives(name) == together


def test_of_two_each_is_an_alternative_of_the_other() -> None:
    known = effects()
    assert all(a in alternatives(b) for a in known for b in alternatives(a))


def test_no_group_has_a_single_effect_as_a_slip_of_the_pen_would_make_it() -> None:
    sizes = Counter(group for e in effects().values() for group in e.looks_like)
    assert min(sizes.values()) > 1, sizes


def test_how_common_they_are() -> None:
    known = effects().values()
    assert {e.id for e in known if e.common == "always"} == ALWAYS
    assert {e.id for e in known if e.common == "often"} == OFTEN


def test_what_their_force_is_drawn_over() -> None:
    found: dict[str, set[str]] = {}
    for e in effects().values():
        found.setdefault(e.plotted_over, set()).add(e.id)
    assert found.pop("position")
    assert found == OVER


def test_errors_of_any_model_have_one_parameter_that_may_be_nothing() -> None:
    known = {e.id: e for e in effects().values() if isinstance(e, Tolerated)}
    assert set(known) == OFF
    assert all([p.neutral is not None for p in e.parameters] == [True] for e in known.values())
    assert {name for name, e in known.items() if e.at_rest} == {"body.mass", "actuator.gain"}
    late = {name for name, e in known.items() if not e.correctable}
    assert late == {"actuator.delay", "sensor.delay"}


HOOKS = [
    (kind, name)
    for kind in vars(hooks).values()
    if isinstance(kind, type) and issubclass(kind, Effect) and kind is not Effect
    for name in vars(kind)
    if not name.startswith("_") and name not in vars(Effect)
]


@pytest.mark.parametrize("name", effects())
def test_no_hook_is_written_that_nobody_calls(name: str) -> None:
    effect = effects()[name]
    for kind, hook in HOOKS:
        assert isinstance(effect, kind) or not hasattr(effect, hook), f"{hook}: derive from {kind}"
