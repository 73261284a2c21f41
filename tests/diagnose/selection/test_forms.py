"""Dry friction as MuJoCo has it by default, and friction that hardly creeps."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.diagnose.hidden_forces import World, chain, on_joint, world
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.forms import in_best_form
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

COULOMB = effects()["joint.friction_coulomb"]
J2 = Location("joint", "j2")


def form(of: World) -> str:
    found = Accepted(Planted(COULOMB, J2, np.array([0.3])), (), ())
    (chosen,) = in_best_form(of.objective, (found,), DecisionLog())
    assert chosen.planted.effect.id == COULOMB.id
    return chosen.planted.effect.form


def test_the_form_is_that_of_the_machine(tmp_path: Path) -> None:
    for name in ("stiff", "creeping"):
        (tmp_path / name).mkdir()
    stiff = on_joint(1, lambda q, v: -0.3 * float(np.tanh(v / 1e-3)))
    assert form(world(tmp_path / "stiff", 2, stiff, 4.0)) == ""
    rubbing = chain(2).replace('name="j2"', 'name="j2" frictionloss=".3"')
    creeping = world(tmp_path / "creeping", 2, None, 4.0, machine=rubbing)
    assert "creeps" in form(creeping)
