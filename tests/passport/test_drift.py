"""Alarms come as seldom as is promised, drifts are found, and days are foretold only if certain."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from wt.passport.drift import FALSE_ALARM, Scatter, alarms, change, scatter, trend
from wt.passport.levels import Sessions

PARAMETERS = 4


def table(
    rng: np.random.Generator,
    units: int,
    sessions: int,
    usual: float = 0.0,
    step: float = 0.0,
    slope: float = 0.0,
) -> Sessions:
    """Sessions three days apart with errors of about 1; the first unit changes.

    Args:
        rng: source of all that is random.
        units: how many.
        sessions: of each.
        usual: standard deviation between sessions in which nothing changes.
        step: what the first unit's last session adds.
        slope: what each of its sessions adds to the one before.
    """
    keys = tuple((f"u{u}", f"2026-01-{3 * s + 1:02d}") for u in range(units)
                 for s in range(sessions))  # fmt: skip
    error = rng.uniform(0.7, 1.4, len(keys))
    value = 10.0 + rng.normal(size=len(keys)) * np.hypot(error, usual)
    value[:sessions] += slope * np.arange(sessions)
    value[sessions - 1] += step
    return Sessions(keys, value, error)


def raised(tables: list[Sessions], unit: str) -> set[tuple[int, str]]:
    """Alarms of a unit's last session, over several parameters."""
    chances = {}
    for i, one in enumerate(tables):
        mine, usual = one.where(np.array([k[0] == unit for k in one.keys])), scatter(one, unit)
        if found := change(mine, usual):
            chances[i, "change"] = found.p
        if line := trend(mine, usual):
            chances[i, "trend"] = line.p
    return alarms(chances)


@pytest.mark.parametrize(
    ("sessions", "usual"), [(2, 0.0), (4, 0.0), (4, 1.0), (4, 3.0)], ids=lambda x: f"{x:g}"
)
def test_false_alarms_are_as_seldom_as_is_promised(sessions: int, usual: float) -> None:
    rng = np.random.default_rng(int(10 * sessions + usual))
    count, false = 0, 0
    for _ in range(80):
        tables = [table(rng, 3, sessions, usual) for _ in range(PARAMETERS)]
        for unit in ("u0", "u1", "u2"):
            count += 1
            false += bool(raised(tables, unit))
    # three standard deviations of a count at the promised rate
    assert count == 240
    assert false <= FALSE_ALARM * count + 3.0 * np.sqrt(FALSE_ALARM * count)


@pytest.mark.parametrize(("step", "slope", "kind"), [(8.0, 0.0, "change"), (0.0, 2.5, "trend")])
def test_a_drift_is_found_where_it_is(step: float, slope: float, kind: str) -> None:
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(40):
        tables = [table(rng, 3, 5, step=step, slope=slope)]
        tables += [table(rng, 3, 5) for _ in range(PARAMETERS - 1)]
        found = raised(tables, "u0")
        hits += (0, kind) in found
    assert hits >= 32


def test_what_errs_alike_in_all_sessions_hides_no_change() -> None:
    """Errors of which most is the machine's own: sessions scatter by a tenth of them."""
    rng = np.random.default_rng(11)
    false = missed = 0
    for _ in range(20):
        tables = []
        for i in range(PARAMETERS):
            one = table(rng, 6, 4, step=40.0 if i == 0 else 0.0)  # four of the said errors
            tables.append(Sessions(one.keys, one.value, 10.0 * one.error))
        missed += (0, "change") not in raised(tables, "u0")
        false += sum(bool(raised(tables, unit)) for unit in ("u1", "u2", "u3", "u4", "u5"))
    assert missed == 0
    assert false <= 4  # three standard deviations beyond 1 of 100


def test_an_intervals_common_error_stays_in_what_is_shown() -> None:
    """Sessions agree to a hundredth of their errors: their mean is no better known for it."""
    keys = tuple((f"u{u}", f"2026-01-{3 * s + 1:02d}") for u in range(4) for s in range(5))
    value = 10.0 + 0.01 * np.random.default_rng(1).normal(size=20)
    one = Sessions(keys, value, np.ones(20))
    found = change(one.where(np.array([k[0] == "u0" for k in keys])), scatter(one, "u0"))
    assert found is not None
    # three quarters of the variance are common, a quarter at least is each session's
    wide = student.ppf(0.975, scatter(one, "u0").freedom) * np.sqrt(0.75 + 0.25 / 4.0)
    assert found.before.high - found.before.value == pytest.approx(wide)


def test_units_at_a_bound_say_nothing_of_scatter() -> None:
    rng = np.random.default_rng(3)
    one = table(rng, 12, 5)
    bound = np.array([k[0] != "u1" for k in one.keys])
    stuck = Sessions(one.keys, np.where(bound, 0.0, one.value), one.error)
    own = one.where(~bound)
    found, alone = scatter(stuck, "u0"), scatter(own, "u0")
    assert found.freedom == alone.freedom == 4
    assert found.share == pytest.approx(alone.share)
    assert found.variance == pytest.approx(alone.variance)


def test_sessions_that_are_judged_are_no_scatter() -> None:
    """A step of the last two would hide itself."""
    one = table(np.random.default_rng(4), 1, 6)
    value = one.value + np.array([0.0, 0.0, 0.0, 0.0, 50.0, 50.0])
    worn = Sessions(one.keys, value, one.error)
    assert scatter(worn, "u0", last=2) == scatter(one.where(np.arange(6) < 4), "u9")
    assert scatter(worn, "u0", last=2).variance < 10.0 < scatter(worn, "u0").variance


def test_a_slow_change_is_no_scatter() -> None:
    """Were it, a unit alone that wears steadily would never be noticed."""
    rng = np.random.default_rng(6)
    one = Sessions(
        tuple(("u0", f"2026-{m:02d}-01") for m in range(1, 13)),
        np.arange(12.0) + 0.1 * rng.normal(size=12),
        np.full(12, 0.1),
    )
    assert scatter(one, "u0").variance < 0.05


def test_holm_stops_at_the_first_that_is_not_small_enough() -> None:
    # of four: 0.01 / 4, / 3, / 2, / 1
    chances = {"a": 0.0024, "b": 0.0032, "c": 0.0051, "d": 0.0099}
    assert alarms(chances) == {"a", "b"}
    assert alarms({}) == set()
    # weighed: .01 · 1/2, then of the two others .01 · 3/4 and .01 · 1/1
    shares = {"a": 2.0, "b": 1.5, "c": 0.5}
    assert alarms({"a": 0.0049, "b": 0.0074, "c": 0.0099}, shares=shares) == {"a", "b", "c"}
    assert alarms({"a": 0.0051, "b": 0.0039, "c": 0.02}, shares=shares) == set()


def line(slope: float, error: float) -> Sessions:
    """Ten sessions a day apart, exactly on a line through 1 on the first day."""
    keys = tuple(("u0", f"2026-01-{d + 1:02d}") for d in range(10))
    return Sessions(keys, 1.0 + slope * np.arange(10.0), np.full(10, error))


def test_the_day_of_a_limit_is_where_the_line_crosses_it() -> None:
    found = trend(line(0.1, 0.01), Scatter())
    assert found is not None
    assert found.slope.value == pytest.approx(0.1)
    day = found.days_until(2.9)
    assert day is not None
    # on the last day the line is at 1.9
    assert day.value == pytest.approx(10.0)
    # ends of Fieller's interval: where the line's own interval reaches the limit
    for end in (day.low, day.high):
        design = np.array([1.0, end])
        half = 1.96 * np.sqrt(design @ found.covariance @ design)
        assert abs(1.9 + 0.1 * end - 2.9) == pytest.approx(half, rel=1e-3)


def test_a_limit_that_lies_behind_is_never_reached() -> None:
    found = trend(line(0.1, 0.01), Scatter())
    assert found is not None
    assert found.days_until(0.5) is None


def test_an_uncertain_slope_has_no_last_day() -> None:
    found = trend(line(0.1, 2.0), Scatter())
    assert found is not None
    assert found.p > 0.05
    day = found.days_until(2.9)
    assert day is not None
    assert day.high == np.inf


def test_of_one_session_nothing_is_said() -> None:
    one = Sessions((("u0", "2026-01-01"),), np.array([1.0]), np.array([0.1]))
    assert change(one, scatter(one, "u0")) is None
    assert trend(one, Scatter()) is None
    assert scatter(one, "u0") == Scatter(0.0, 0)
