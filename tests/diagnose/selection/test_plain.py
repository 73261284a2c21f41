"""A plain curve of the position takes the place of waves that are not seen to come again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, World, on_joint, world
from wt.diagnose.likelihood.estimate import fitted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.plain import Curves, curves_in_disguise
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location

CUBIC = 1.5  # N·m/rad³


def at_first(name: str, *theta: float) -> Planted:
    """An effect at the first joint, or at its drive."""
    effect = effects()[name]
    places = {"joint": "j1", "actuator": "a1"}
    return Planted(effect, Location(effect.kind, places[effect.kind]), np.array(theta))


def curves(hidden: World, *parts: Planted) -> tuple[Curves, Hypothesis]:
    """Curves that would do in the place of effects, refined, and these."""
    now = fitted(hidden.objective, parts)
    log = DecisionLog()
    parts = now.hypothesis
    return curves_in_disguise(hidden.objective, hidden.held, parts, STEP, log), parts


@pytest.fixture(scope="module")
def rubber(tmp_path_factory: pytest.TempPathFactory) -> World:
    law = on_joint(0, lambda q, v: -CUBIC * q**3)
    return world(tmp_path_factory.mktemp("rubber"), 1, law, 8.0)


def test_rubber_is_no_spring_and_ripple(rubber: World) -> None:
    q = rubber.objective.motion.q[:, 0]
    cycles = 1.1 * 2.0 * np.pi / np.ptp(q)
    found, named = curves(
        rubber,
        at_first("joint.stiffness", 0.8 * np.ptp(q) ** 2, 0.0),
        at_first("actuator.ripple", 0.2, cycles, 0.0),
    )
    assert [i in found.replaced for i in range(len(named))] == [True, True]
    (law,) = found.laws.values()
    inside = np.linspace(q.min(), q.max(), 50)
    assert law.columns == ("qpos/j1",)
    right = -CUBIC * inside**3
    assert law.force(inside[:, None]) == pytest.approx(right, abs=0.02 * np.abs(right).max())
    (unknown,) = found.learned(rubber.screen, (), rubber.held, STEP, 0)
    assert unknown.gain.share > 0.9 and unknown.formula == law.text()


def test_a_ripple_of_little_more_than_a_wave_stays(tmp_path: Path) -> None:
    quiet = world(tmp_path, 1, None, 8.0)
    cycles = 1.15 * 2.0 * np.pi / np.ptp(quiet.objective.motion.q[:, 0])
    law = on_joint(0, lambda q, v: 0.5 * float(np.sin(cycles * q + 0.4)))
    rippled = world(tmp_path, 1, law, 8.0)
    found, (ripple,) = curves(rippled, at_first("actuator.ripple", 0.5, cycles, 0.4))
    assert not found and ripple.possible(rippled.objective.motion)
