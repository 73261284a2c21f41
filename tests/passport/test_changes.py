"""A change is told once, in its session, and afterwards is what the unit is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from tests.passport.passports import ELBOW, ERROR, UNITS
from wt.data.labels import Labels
from wt.passport.card import Card, card, differences
from wt.passport.changes import judged
from wt.passport.estimates import GroupEstimate, Quantity
from wt.passport.levels import Sessions
from wt.passport.text import changed

WET = Quantity("joint.friction_viscous", "joint", "elbow", "coefficient", "N·m·s/rad")
USUAL, WORN, LIMIT = 0.21, 0.34, {str(ELBOW): 0.5}  # N·m


def carded(told: Mapping[str, Sequence[float]], noise: float = 1.0) -> Card:
    """Cards of units of which some are told what they were at, three days apart [N·m].

    Args:
        told: by unit.
        noise: errors, as a share of what they are said to be.
    """
    rng = np.random.default_rng(1)
    count = len(next(iter(told.values())))
    rows = [
        GroupEstimate(
            Labels(unit, f"2026-11-{1 + 3 * i:02d}"),
            ELBOW,
            value + noise * ERROR[ELBOW] * float(rng.normal()),
            ERROR[ELBOW],
            0.0,
        )
        for unit in UNITS
        for i, value in enumerate(told.get(unit, [USUAL] * count))
    ]
    return card(rows, LIMIT)


@pytest.mark.parametrize("after", [1, 2, 3, 4])
def test_a_change_is_told_in_its_session_and_never_again(after: int) -> None:
    before = [USUAL] * 4
    now = carded({"A17": [*before, WORN]})
    assert [(unit, state.changed) for unit, _, state in now.alarms] == [("A17", True)]
    of = carded({"A17": [*before, WORN, *[WORN] * after]})
    assert of.alarms == []
    assert of.states["A17"][ELBOW].since == 4


def test_what_one_session_did_not_show_for_certain_two_do() -> None:
    """A step of five errors: two sessions in which it is there are enough."""
    usual = [USUAL + e * ERROR[ELBOW] for e in (1.0, -1.0, 0.9, -1.05, 1.1, -0.9, 0.8)]
    worn = [*usual[:4], *(value + 5.0 * ERROR[ELBOW] for value in usual[4:])]

    def until(sessions: int) -> Card:
        others = {unit: usual[:sessions] for unit in UNITS}
        return carded({**others, "A17": worn[:sessions]}, 0.0)

    assert until(5).alarms == []
    of = until(6)
    state = of.states["A17"][ELBOW]
    assert state.changed and state.change is not None and state.change.last == 2
    assert "rose from 0.210 to 0.261 N·m in 6 days" in changed(ELBOW, state)
    (apart,) = differences(of, "A17", "B04")
    assert apart.one.value == pytest.approx(state.value.value)
    later = until(7)
    assert later.alarms == [] and later.states["A17"][ELBOW].since == 4


def test_steps_that_go_on_are_a_slow_change() -> None:
    """Each is far beyond the errors; what they are together has a day on which it ends."""
    rising = [USUAL + 0.09 * i for i in range(3)]
    assert carded({"A17": rising[:2]}, 0.3).states["A17"][ELBOW].changed
    state = carded({"A17": rising}, 0.3).states["A17"][ELBOW]
    assert state.drifts and not state.changed and state.since == 0
    assert "rises by 0.03" in changed(ELBOW, state) and state.reached is not None
    # and two steps that are no line stay what they are
    back = carded({"A17": [USUAL, WORN, USUAL]}, 0.3).states["A17"][ELBOW]
    assert back.changed and not back.drifts


def test_a_worn_unit_is_another_unit_and_not_another_session() -> None:
    of = carded({"A17": [USUAL] * 3 + [WORN] * 3})
    assert of.levels[ELBOW].level == "unit"
    assert of.states["A17"][ELBOW].value.low <= WORN <= of.states["A17"][ELBOW].value.high
    assert of.states["B04"][ELBOW].value.low <= USUAL <= of.states["B04"][ELBOW].value.high


def test_a_step_foretells_nothing() -> None:
    """The slope over it is significant; that it goes on is not."""
    of = carded({"A17": [USUAL] * 5 + [WORN]})
    state = of.states["A17"][ELBOW]
    assert state.trend is not None and state.trend.p < 1e-3
    assert state.reached is None and "it reaches" not in changed(ELBOW, state)


def test_what_lies_on_no_line_foretells_nothing() -> None:
    """It rose, and has been what it is for long: the slope is significant all the same."""
    state = carded({"A17": [0.21, 0.25, 0.29, 0.33, 0.33, 0.33, 0.33]}).states["A17"][ELBOW]
    assert state.drifts and state.trend is not None and not state.trend.straight
    assert state.reached is None


def test_a_slow_change_is_told_as_one_and_has_a_day() -> None:
    of = carded({"A17": [0.21, 0.23, 0.25, 0.27, 0.29, 0.31]})
    state = of.states["A17"][ELBOW]
    assert state.drifts and not state.changed
    assert "rises by 0.00" in changed(ELBOW, state)
    assert state.reached is not None and state.reached.low < 28.5 < state.reached.high
    # what two units differ by is of the values that the cards show
    (found,) = differences(of, "A17", "B04")
    assert found.one.value == pytest.approx(state.value.value)


def test_there_and_back_are_two_changes() -> None:
    went = [USUAL] * 3 + [WORN]
    assert changed(ELBOW, carded({"A17": went}).states["A17"][ELBOW]).startswith("Joint elbow's")
    back = carded({"A17": [*went, USUAL]}).states["A17"][ELBOW]
    assert back.changed and "fell from 0.3" in changed(ELBOW, back)
    assert carded({"A17": [*went, USUAL, USUAL]}).alarms == []


def test_after_a_change_false_alarms_are_as_seldom_as_before() -> None:
    rng = np.random.default_rng(9)
    keys = tuple((u, f"2026-01-{3 * s + 1:02d}") for u in ("u0", "u1", "u2") for s in range(6))
    false = 0
    for _ in range(40):
        value, error = 10.0 + rng.normal(size=(2, len(keys))), np.ones(len(keys))
        value[0, 3:6] += 12.0
        tables = {q: Sessions(keys, v, error) for q, v in zip((ELBOW, WET), value, strict=True)}
        false += any(one.changed or one.drifts for one in judged(tables)["u0"].values())
    assert false <= 2
