"""Parameters are put where they were planted, with the errors that are promised."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from wt.data.labels import Labels
from wt.passport.levels import CHANCE, Placed, place


def groups(units: int, sessions: int, loads: tuple[str, ...] = ("none",)) -> list[Labels]:
    """Labels of every unit in every session under every load."""
    return [
        Labels(f"u{u}", f"2026-01-{s + 1:02d}", load)
        for u in range(units)
        for s in range(sessions)
        for load in loads
    ]


def planted(
    labels: list[Labels],
    rng: np.random.Generator,
    units: dict[str, float] | None = None,
    session: float = 0.0,
    load: float = 0.0,
    group: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimates around 10, and their errors of about 1.

    Args:
        labels: of each group.
        rng: source of all that is random.
        units: what each unit adds.
        session: standard deviation between sessions of a unit.
        load: what any load adds.
        group: standard deviation between groups, whatever they are.
    """
    error = rng.uniform(0.7, 1.4, len(labels))
    keys = dict.fromkeys((k.unit, k.session) for k in labels)
    of_session = {key: session * rng.normal() for key in keys}
    truth = [
        10.0
        + (units or {}).get(k.unit, 0.0)
        + of_session[k.unit, k.session]
        + load * (k.load != "none")
        + group * rng.normal()
        for k in labels
    ]
    return np.array(truth) + error * rng.normal(size=len(labels)), error


def trials(
    count: int,
    labels: list[Labels],
    seed: int,
    units: dict[str, float] | None = None,
    session: float = 0.0,
    load: float = 0.0,
    group: float = 0.0,
) -> tuple[Counter[str], list[Placed]]:
    """Levels of many draws, and what was said of each."""
    rng = np.random.default_rng(seed)
    found = [
        place(labels, *planted(labels, rng, units, session, load, group)) for _ in range(count)
    ]
    return Counter(p.level for p in found), found


@pytest.mark.long
def test_a_parameter_of_the_model_is_put_elsewhere_as_seldom_as_is_promised() -> None:
    counts, found = trials(300, groups(3, 3), seed=1)
    # three standard deviations of a count at the promised rate
    assert 300 - counts["model"] <= 300 * CHANCE + 3.0 * np.sqrt(300 * CHANCE)
    inside = np.mean([p.model.low <= 10.0 <= p.model.high for p in found])
    assert 0.91 <= inside <= 0.985
    same = [p for p in found if p.level == "model"]
    assert all(set(p.units.values()) == {p.model} for p in same)


def test_one_unit_that_is_three_deviations_off_is_found() -> None:
    counts, found = trials(100, groups(4, 3), seed=2, units={"u3": 3.0})
    assert counts["unit"] >= 70
    right = [p for p in found if p.level == "unit"]
    inside = np.mean([p.units["u3"].low <= 13.0 <= p.units["u3"].high for p in right])
    assert inside >= 0.88  # those that were found are those that seem large


def test_units_that_differ_clearly_are_the_level() -> None:
    offsets = {"u0": -4.0, "u1": 0.0, "u2": 2.0, "u3": 5.0}
    counts, found = trials(100, groups(4, 3), seed=3, units=offsets)
    assert counts["unit"] >= 97
    spreads = [p.unit_spread for p in found if p.unit_spread]
    assert len(spreads) == 100
    # what these four differ by is 3.8
    assert 3.3 < np.median([s.value for s in spreads]) < 4.3
    assert all(s.low > 0.0 for s in spreads)


def test_sessions_that_differ_are_not_taken_for_units() -> None:
    counts, found = trials(100, groups(4, 4), seed=4, session=3.0)
    assert counts["session"] >= 95
    assert np.mean([p.tests["unit"].p < CHANCE for p in found]) <= 0.05
    spreads = [p.session_spread for p in found if p.session_spread]
    assert 0.88 <= np.mean([s.low <= 3.0 <= s.high for s in spreads]) <= 1.0


def test_a_load_adds_the_same_everywhere() -> None:
    counts, found = trials(60, groups(3, 2, ("none", "disc")), seed=5, load=4.0)
    assert counts["load"] >= 57
    added = [p.loads["disc"] for p in found if p.loads]
    assert np.mean([a.low <= 4.0 <= a.high for a in added]) >= 0.88


def test_a_load_is_not_mistaken_for_the_day_on_which_it_was_carried() -> None:
    """Each session has one load: it shows between the sessions of a unit only."""
    labels = [
        Labels(f"u{u}", f"2026-01-{s + 1:02d}", "disc" if s % 2 else "none")
        for u in range(3)
        for s in range(4)
    ]
    counts, found = trials(60, labels, seed=6, load=5.0)
    assert counts["load"] >= 55
    assert all(p.sessions.value.mean() < 12.0 for p in found if p.loads)


def test_what_no_level_explains_is_said() -> None:
    counts, _ = trials(40, groups(3, 3, ("none", "disc")), seed=7, group=5.0)
    assert counts["unexplained"] >= 38


def test_left_out_units_and_sessions_are_predicted() -> None:
    _, found = trials(60, groups(4, 3), seed=8)
    for what, count in (("unit", 4), ("session", 12)):
        mine = [h for p in found for h in p.held_out if h.what == what]
        assert {h.count for h in mine} == {count}
        assert 0.91 <= sum(h.inside for h in mine) / (60 * count) <= 0.985


def test_what_few_recordings_cannot_tell_is_said() -> None:
    rng = np.random.default_rng(9)
    one = place(groups(1, 3), *planted(groups(1, 3), rng))
    assert one.unit_spread is None
    assert "one unit" in one.notes[0]
    labels = groups(3, 1)
    few = place(labels, *planted(labels, rng, units={"u2": 20.0}))
    assert few.level == "unit"
    assert "may be the session's" in few.notes[0]
    single = place(groups(1, 1), np.array([3.0]), np.array([0.5]))
    assert single.level == "model"
    assert single.model == pytest.approx((3.0, 3.0 - 0.98, 3.0 + 0.98), abs=1e-3)
    own = [Labels("u0", "2026-01-01", "none"), Labels("u1", "2026-01-01", "disc")]
    both = place(own, np.array([1.0, 9.0]), np.array([0.5, 0.5]))
    assert both.level == "unit"
    assert "Loads and units cannot be told apart" in both.notes[0]


def test_the_statistics_are_those_of_the_textbook() -> None:
    """Q, and the variance of DerSimonian and Laird, of four sessions worked out by hand."""
    labels, value = groups(1, 4), np.array([1.0, 3.0, 6.0, 2.0])
    found = place(labels, value, np.ones(4))
    # mean 3, squares 4 + 0 + 9 + 1
    assert found.tests["session"].statistic == pytest.approx(14.0)
    assert found.tests["session"].freedom == (3,)
    assert found.session_spread is not None
    assert found.session_spread.value**2 == pytest.approx((14.0 - 3.0) / 3.0)
    # the profile: 14 / (1 + v) is the 97.5 % and the 2.5 % point of chi² with 3 degrees of freedom
    assert found.session_spread.low**2 == pytest.approx(14.0 / 9.3484 - 1.0, rel=1e-3)
    assert found.session_spread.high**2 == pytest.approx(14.0 / 0.215795 - 1.0, rel=1e-3)
