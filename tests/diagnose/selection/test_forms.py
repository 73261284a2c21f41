"""Dry friction as MuJoCo has it by default, and friction that hardly creeps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np

from tests.diagnose.hidden_forces import World, chain, on_joint, world
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.candidates import candidates
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.forms import in_best_form
from wt.physics.effect import Effect, effects
from wt.physics.hooks import shaped
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location

COULOMB = effects()["joint.friction_coulomb"]
FORMS = (COULOMB, *COULOMB.forms)
J2 = Location("joint", "j2")


def form(of: World, found_as: Effect) -> str:
    found = Accepted(Planted(found_as, J2, np.array([0.3])), (), ())
    (chosen,) = in_best_form(of.objective, of.objective, (found,), DecisionLog())
    assert chosen.planted.effect.id == COULOMB.id
    return chosen.planted.effect.form


def test_the_form_is_that_of_the_machine(tmp_path: Path) -> None:
    for name in ("stiff", "creeping"):
        (tmp_path / name).mkdir()
    stiff = on_joint(1, lambda q, v: -0.3 * float(np.tanh(v / 1e-3)))
    one = world(tmp_path / "stiff", 2, stiff, 4.0)
    assert {form(one, as_found) for as_found in FORMS} == {""}
    rubbing = chain(2).replace('name="j2"', 'name="j2" frictionloss=".3"')
    creeping = world(tmp_path / "creeping", 2, None, 4.0, machine=rubbing)
    assert all("creeps" in form(creeping, as_found) for as_found in FORMS)


def test_a_law_is_replayed_in_each_of_its_forms(tmp_path: Path) -> None:
    """Slow joints of a simulator that creeps have no dry friction that hardly does."""
    rubbing = chain(2).replace('name="j2"', 'name="j2" frictionloss=".3"')
    slow = world(tmp_path, 2, None, 4.0, machine=rubbing)
    now = slow.objective.reference(())
    ranked = slow.screen.rank(())
    proposed = candidates(slow.screen, ranked, slow.objective, now)
    replayed = {p.effect for p, _ in proposed if p.key == (COULOMB.id, J2.kind, J2.name)}
    assert replayed == set(FORMS)


def test_what_has_one_form_stays_what_it_was_bound_to(tmp_path: Path) -> None:
    """Pushes at times that were read off these recordings; and no replay is asked about them."""
    pushes = shaped(effects()["body.force_intermittent"], (0.0, 0.0, 1.0, 2.0))
    found = Accepted(Planted(pushes, Location("body", "link1"), np.ones(pushes.n_theta)), (), ())
    replays = Mock(spec=Objective)
    (kept,) = in_best_form(replays, replays, (found,), DecisionLog())
    assert kept is found


def test_all_recordings_are_asked_only_of_what_a_part_of_them_does_not_refuse() -> None:
    quick, objective = Mock(spec=Objective), Mock(spec=Objective)
    found = tuple(
        Accepted(Planted(COULOMB, Location("joint", name), np.array([0.3])), (), ())
        for name in ("j1", "j2")
    )

    def likelier_creeping(joint: str) -> Callable[[Hypothesis], Mock]:
        def reference(hypothesis: Hypothesis) -> Mock:
            (one,) = [p for p in hypothesis if p.at.name == joint]
            others = sum(p.effect is not COULOMB for p in hypothesis if p is not one)
            return Mock(loglik=(30.0 if one.effect is not COULOMB else 0.0) - 30.0 * others)

        return reference

    quick.reference.side_effect = likelier_creeping("j2")
    objective.reference.side_effect = likelier_creeping("j2")
    chosen = in_best_form(quick, objective, found, DecisionLog())
    assert [bool(a.planted.effect.form) for a in chosen] == [False, True]
    # of j1 a part sufficed
    assert quick.reference.call_count == 3 and objective.reference.call_count == 2
