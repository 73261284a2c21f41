"""Parameters that ran to the end of their range are another law's."""

from __future__ import annotations

import numpy as np
import pytest

from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

AT = {"body": "link", "actuator": "a", "joint": "j", "sensor": "all"}


def at_limit(name: str, *theta: float) -> str | None:
    effect = effects()[name]
    place = Location(effect.kind, AT[effect.kind])
    return Planted(effect, place, np.array(theta)).at_limit()


@pytest.mark.parametrize(
    ("name", "theta", "which"),
    [
        ("body.inertia", (0.01,), "factor"),
        ("body.mass", (10.0,), "factor"),
        ("body.com", (0.1, 0.0, -2.0), "shift"),
        ("sensor.scale", (0.1,), "factor"),
        ("actuator.delay", (0.3,), "delay"),
    ],
)
def test_the_end_of_a_range_is_no_answer(name: str, theta: tuple[float, ...], which: str) -> None:
    assert at_limit(name, *theta) == which


@pytest.mark.parametrize(
    ("name", "theta"),
    [
        ("body.inertia", (0.012,)),  # far from the end of a factor, though near it beside its range
        ("actuator.gain", (0.0,)),  # a dead drive
        ("actuator.delay", (0.0,)),  # nothing
        ("joint.friction_load", (0.2, 1.0)),  # all of the load
        ("body.com", (0.1, 0.0, -0.2)),
    ],
)
def test_natural_ends_and_all_between_are(name: str, theta: tuple[float, ...]) -> None:
    assert at_limit(name, *theta) is None
