"""What was recorded once is not told twice, in whatever encoding; another run is another one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.diagnose.hidden_forces import NOISE, RATE, chain, record
from wt.diagnose.recordings.repeated import refuse_repeated, repeated
from wt.errors import RecordingError
from wt.types import Recording

ONE = record(chain(2), None, 6.0, 0)


def each(change: Callable[[np.ndarray], np.ndarray]) -> Recording:
    return replace(ONE, columns={name: change(x) for name, x in ONE.columns.items()})


def part(first: int, last: int) -> Recording:
    columns = {name: x[first:last] for name, x in ONE.columns.items()}
    return replace(ONE, t=ONE.t[first:last] - ONE.t[first], columns=columns)


def run_again(noise: float, rate: int = RATE) -> Recording:
    """The same motion of the same machine, with the noise of another run; and the first alike."""
    rng, every = np.random.default_rng(1), RATE // rate
    columns = {n: x + noise * rng.standard_normal(len(x)) for n, x in ONE.columns.items()}
    return replace(ONE, t=ONE.t[::every], columns={n: x[::every] for n, x in columns.items()})


@pytest.mark.parametrize(
    ("copy", "start"),
    [
        (each(lambda x: x.astype(np.float32).astype(float)), 0.0),
        (each(lambda x: np.round(x, 6)), 0.0),
        (replace(ONE, t=ONE.t + 17.0), 0.0),
        (part(300, 900), 300 / RATE),
    ],
    ids=["single precision", "six decimals", "another clock", "a part"],
)
def test_a_copy_is_one(copy: Recording, start: float) -> None:
    assert repeated(ONE, copy) == pytest.approx(start)
    assert repeated(copy, ONE) == pytest.approx(start)
    with pytest.raises(RecordingError, match=r"'b' holds the motion of 'a'.*held out"):
        refuse_repeated([("a", ONE), ("b", copy)], 1)
    with pytest.raises(RecordingError, match="is no more likely"):
        refuse_repeated([("a", ONE), ("b", copy)], 2)


@pytest.mark.parametrize("rate", [RATE, 25])
def test_another_run_of_the_same_motion_is_none(rate: int) -> None:
    """Of a slow log differences have much of the motion in them, and are no noise."""
    first = run_again(0.0, rate)
    assert repeated(first, run_again(2.0 * NOISE, rate)) is None
    refuse_repeated([("a", first), ("b", run_again(2.0 * NOISE, rate))], 1)


def test_gaps_and_columns_without_values_tell_nothing() -> None:
    gone = dict(ONE.columns) | {"qpos/j2": np.full(len(ONE.t), np.nan)}
    gone["qpos/j1"] = ONE.columns["qpos/j1"].copy()
    gone["qpos/j1"][:80] = np.nan
    assert repeated(ONE, replace(ONE, columns=gone)) == 0.0
    assert repeated(ONE, replace(ONE, columns={"qpos/j2": gone["qpos/j2"]})) is None


def test_another_motion_or_one_at_rest_is_none() -> None:
    assert repeated(ONE, record(chain(2), None, 6.0, 1)) is None
    still = each(np.zeros_like)
    assert repeated(still, still) is None
