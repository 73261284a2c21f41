"""Laws that are no different from a simpler one, as far as the recordings tell."""

from __future__ import annotations

import numpy as np
import pytest

from tests.diagnose.hidden_forces import World, on_joint, world
from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.alternatives import simplified
from wt.diagnose.selection.decisions import DecisionLog
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

J2 = Location("joint", "j2")
LOAD = effects()["joint.friction_load"]
STRIBECK = effects()["joint.friction_stribeck"]


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A chain with dry friction in j2, and nothing else."""
    friction = on_joint(1, lambda q, v: -0.3 * float(np.tanh(v / 1e-3)))
    return world(tmp_path_factory.mktemp("rubbing"), 2, friction, 8.0)


def test_friction_that_no_load_changes_is_coulombs(rubbing: World) -> None:
    planted = Planted(LOAD, J2, np.array([0.28, 0.01]))
    coulomb = Planted(effects()["joint.friction_coulomb"], J2, np.array([0.29]))
    stribeck = Planted(STRIBECK, J2, np.array([0.28, 0.3, 0.1]))
    given = (Accepted(planted, None, (coulomb, stribeck)),)
    before = estimate(rubbing.objective, (planted,))
    assert before.estimates[0]["fraction"].ci95[0] == 0.0
    accepted, after = simplified(rubbing.objective, given, before, DecisionLog())
    assert [a.planted.effect.id for a in accepted] == ["joint.friction_coulomb"]
    assert accepted[0].rivals == (stribeck,), "a law must not be its own rival"
    assert accepted[0].shape == ()
    assert after.estimates[0]["coulomb"].value == pytest.approx(0.3, rel=0.03)


def test_what_is_needed_stays(rubbing: World) -> None:
    motion = rubbing.screen.motion
    load = float(np.abs(motion.drive_forces[:, 1]).mean())
    theta = np.array([0.1, 0.2])
    assert LOAD.simpler(motion, J2, theta, {"fraction": (0.1, 0.3)}) is None
    law, values = LOAD.simpler(motion, J2, theta, {"fraction": (0.0, 0.4)})  # type: ignore[misc]
    assert law == "joint.friction_coulomb" and values == pytest.approx([0.1 + 0.2 * load])
    rise = np.array([0.1, 0.3, 0.1])
    assert STRIBECK.simpler(motion, J2, rise, {"coulomb": (0.0, 0.2), "static": (0.25, 1)}) is None
    found = STRIBECK.simpler(motion, J2, rise, {"coulomb": (0.0, 0.2), "static": (0.15, 1)})
    assert found is not None and found[1] == pytest.approx([0.1])


def test_a_load_that_adds_next_to_nothing_is_none(rubbing: World) -> None:
    motion = rubbing.screen.motion
    load = float(np.abs(motion.drive_forces[:, 1]).mean())
    assert not LOAD.plausible(motion, J2, np.array([1.0, 0.03 / load]))
    assert LOAD.plausible(motion, J2, np.array([1.0, 0.1 / load]))
