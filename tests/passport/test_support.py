"""An effect that few groups found stays if one of them needs it, and goes if none does."""

from __future__ import annotations

import numpy as np
import pytest

from tests.passport.test_add import RIG, record
from wt.diagnose import again
from wt.diagnose.again import Recorded
from wt.passport.support import borne_out
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

WORN = (0.0, 0.4, 0.0)  # N·m of dry friction, by unit: the second is worn
HINGE = Location("joint", "hinge")


def planted(effect: str, *theta: float) -> Planted:
    return Planted(effects()[effect], HINGE, np.array(theta))


DRY, SPRING = planted("joint.friction_coulomb", 0.3), planted("joint.stiffness", 0.5, 0.1)


@pytest.fixture(scope="module")
def groups(tmp_path_factory: pytest.TempPathFactory) -> list[Recorded]:
    home = tmp_path_factory.mktemp("units")
    (home / "rig.xml").write_text(RIG.format(friction=""))
    files = [record(home / f"{i}.parquet", f, i, {"unit": f"U{i}"}) for i, f in enumerate(WORN)]
    return [again.recorded(home / "rig.xml", [file]) for file in files]


def test_the_fault_of_one_machine_stays_and_what_another_was_taken_for_goes(
    groups: list[Recorded],
) -> None:
    found = [(SPRING,), (DRY,), ()]
    kept, notes = borne_out((DRY, SPRING), found, groups)
    assert [p.key for p in kept] == [DRY.key]
    (note,) = notes
    assert "stiffness" in note and "1 of 3 groups" in note


def test_what_many_found_is_not_asked_again(groups: list[Recorded]) -> None:
    found = [(SPRING,), (SPRING,), (DRY,)]
    kept, notes = borne_out((DRY, SPRING), found, groups)
    assert {p.key for p in kept} == {DRY.key, SPRING.key} and not notes


def test_what_the_passport_has_stays_though_no_new_group_needs_it(groups: list[Recorded]) -> None:
    found = [(DRY, SPRING), (DRY,), (DRY,), (DRY,)]
    new = [groups[0], groups[2]]
    assert borne_out((DRY, SPRING), found, new, known=(SPRING,)) == ((DRY, SPRING), ())
    kept, _ = borne_out((DRY, SPRING), found, new)
    assert [p.key for p in kept] == [DRY.key]


def test_what_an_effect_is_worth_is_what_recordings_lose_without_it(
    groups: list[Recorded],
) -> None:
    worth = [again.worth_of(of, (DRY, SPRING), DRY) for of in groups]
    assert worth[1] > 100.0 > 0.0 > max(worth[0], worth[2])
    assert again.worth_of(groups[1], (DRY,), SPRING) == -np.inf, "it is none of them"
