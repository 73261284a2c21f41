"""One hypothesis for all groups, and its estimates as rows of scalars."""

from __future__ import annotations

import numpy as np
import pytest

from wt.data.labels import Labels
from wt.diagnose.result import Estimate
from wt.passport.estimates import common, rows
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

ELBOW, HAND = Location("joint", "elbow"), Location("body", "hand")


def planted(effect: str, at: Location, *theta: float) -> Planted:
    """An effect with parameters."""
    return Planted(effects()[effect], at, np.array(theta))


def test_what_any_group_shows_is_estimated_in_all() -> None:
    dry = [planted("joint.friction_coulomb", ELBOW, x) for x in (0.1, 0.9, 0.2)]
    wet = planted("joint.friction_viscous", ELBOW, 0.3)
    hypothesis, notes = common([(dry[0], wet), (dry[1],), (), (dry[2],)])
    assert [p.key[0] for p in hypothesis] == ["joint.friction_coulomb", "joint.friction_viscous"]
    np.testing.assert_array_equal(hypothesis[0].theta, [0.2])
    assert notes == ()


def test_of_two_that_exclude_each_other_the_more_frequent_stays() -> None:
    play = planted("joint.backlash", ELBOW, 0.02, 0.5)
    soft = planted("joint.elasticity", ELBOW, 50.0, 0.1)
    elsewhere = planted("joint.elasticity", Location("joint", "wrist"), 50.0, 0.1)
    hypothesis, (note,) = common([(play, elsewhere), (soft,), (play,)])
    assert {p.key for p in hypothesis} == {play.key, elsewhere.key}
    assert "joint.elasticity at joint elbow was found once and joint.backlash there 2 times" in note


def test_two_names_of_one_thing_are_not_estimated_beside_each_other() -> None:
    """Found in different units, both together left Coulomb's error 40 times as large."""
    dry = planted("joint.friction_coulomb", ELBOW, 0.02)
    along = planted("joint.friction_position", ELBOW, 0.03, 0.15, 0.5, 3.4)
    hypothesis, (note,) = common([(dry,), (along,), (dry,)])
    assert [p.key for p in hypothesis] == [dry.key]
    assert "joint.friction_position at joint elbow was found once" in note
    hypothesis, notes = common([(dry,), (dry, along)])
    assert {p.key for p in hypothesis} == {dry.key, along.key} and notes == ()


def test_vectors_become_a_row_a_component() -> None:
    shift = planted("body.com", HAND, 0.01, 0.0, -0.02)
    known = Estimate(
        (0.01, 0.0, -0.02), "m", ((0.008, -2.0, -0.03), (0.012, 2.0, -0.01)), unshown=("y",)
    )
    labels = Labels("A17", "2026-11-25")
    found = rows(labels, [(shift, {"shift": known})])
    assert [str(r.quantity) for r in found] == [
        f"body.com/hand/shift.{axis}" for axis in ("x", "y", "z")
    ]
    assert [r.value for r in found] == [0.01, 0.0, -0.02]
    np.testing.assert_allclose([r.error for r in found], np.array([2e-3, 2.0, 0.01]) / 1.96, 1e-3)
    assert [bool(r.warning) for r in found] == [False, True, False]
    assert {r.neutral for r in found} == {0.0}


def test_an_end_that_a_bound_has_cut_off_says_less_than_the_other() -> None:
    dry = planted("joint.friction_coulomb", ELBOW, 0.01)
    known = {"coulomb": Estimate(0.01, "N·m", (0.0, 0.05))}
    (row,) = rows(Labels("A17", "2026-11-25"), [(dry, known)])
    assert row.error == pytest.approx(0.04 / 1.96, rel=1e-3)
