"""Forces of effects along a motion, and when events happened in other recordings."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import ARM, motion, scene, simulate
from wt.diagnose.likelihood.tolerances import tolerances
from wt.diagnose.residual.signature import elsewhere, force, unsaid
from wt.diagnose.unknown.force import UnknownForce
from wt.diagnose.unknown.law import Atom, Law
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

J1, B2 = Location("joint", "j1"), Location("body", "b2")
PUSH, START, END = (6.0, 2.0, -5.0), 0.8, 1.1


def pushed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    if START <= data.time < END:
        data.xfrc_applied[model.body("b2").id, :3] += PUSH


def test_force_is_that_of_the_parameters(tmp_path: Path) -> None:
    moved = motion(scene(tmp_path), simulate(ARM))

    def along(name: str, at: Location, *theta: float) -> np.ndarray:
        found = force(moved, Planted(effects()[name], at, np.array(theta)))
        assert found is not None
        assert not found[:, [0, 2]].any()
        return found[:, 1]

    v = moved.v[:, 1]
    assert along("joint.friction_viscous", J1, 0.4) == pytest.approx(-0.4 * v)
    fast = np.abs(v) > 0.2
    dry = along("joint.friction_coulomb", J1, 0.7)
    assert dry[fast] == pytest.approx(-0.7 * np.sign(v[fast]), rel=0.02)
    drive = moved.drive_forces[:, 1]
    weaker = along("actuator.gain", Location("actuator", "m1"), 0.8)
    assert weaker == pytest.approx(-0.2 * drive, abs=1e-6 * np.abs(drive).max())


def test_what_any_rig_is_off_by_takes_no_event_for_its_own(tmp_path: Path) -> None:
    moved = motion(scene(tmp_path), simulate(ARM, pushed))
    event = effects()["body.force_intermittent"].shaped((0.0, 5.0, 6.0))
    push = Planted(event, B2, np.array(PUSH))
    small = tuple(n.scaled(0.3) for n in tolerances(moved.scene) if n.effect.correctable)
    assert len(small) > 3
    found = elsewhere(moved, (push, *small))
    assert found[1:] == small
    windows = found[0].effect.observed()["windows"][1]
    assert windows == pytest.approx((START, END), abs=0.03)


def learned(*terms: tuple[Atom, ...]) -> Planted:
    """A learned law of j1's velocity, each term with the weight −0.6."""
    weights = np.full(len(terms), -0.6)
    law = Law(("qvel/j1",), np.array([-50.0]), np.array([50.0]), terms, weights)
    return Planted(UnknownForce(law, "something brakes j1"), J1, np.ones(1))


def test_a_learned_law_that_named_effects_say_themselves_is_theirs(tmp_path: Path) -> None:
    moved = motion(scene(tmp_path), simulate(ARM))
    dry = Planted(effects()["joint.friction_coulomb"], J1, np.array([0.9]))
    viscous = Planted(effects()["joint.friction_viscous"], J1, np.array([0.1]))
    sign, linear = (Atom(0, "sign", b=0.05),), (Atom(0, "linear"),)
    assert unsaid(moved, learned(sign), [dry], 1) < 0.05
    assert unsaid(moved, learned(sign), [viscous], 1) > 0.1
    assert unsaid(moved, learned(sign, linear), [dry], 1) > 0.1
    assert unsaid(moved, learned(sign, linear), [dry, viscous], 1) < 0.05
    assert unsaid(moved, learned(sign), [], 1) == 1.0
