"""The nouns check themselves and cannot be changed afterwards."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from wt.errors import DataError, RecordingError
from wt.types import Channel, Pairs, Recording, Transitions, TransitionSpec

N = 6


def fields(**changes: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    made = {
        "o": rng.standard_normal((N, 3)),
        "a": rng.standard_normal((N, 1)),
        "s_next": rng.standard_normal((N, 2)),
        "nominal": rng.standard_normal((N, 2)),
        "hidden": np.full((N, 1), np.nan),
        "episode": np.arange(N) // 3,
        "step": np.arange(N) % 3,
    }
    return made | changes


def recording(**changes: object) -> Recording:
    t = np.linspace(0, 4, 201)
    values: dict[str, object] = {
        "t": t, "columns": {"ctrl/m": np.sin(t), "qpos/j": np.cos(t)}, "meta": {"robot": "toy"},
    }  # fmt: skip
    return Recording(**(values | changes))  # type: ignore[arg-type]


def test_transitions_own_their_arrays() -> None:
    given = fields()
    data = Transitions(**given)
    before = data.o.copy()
    given["o"][:] = 0
    np.testing.assert_array_equal(data.o, before)
    for f in dataclasses.fields(data):
        array = getattr(data, f.name)
        assert array.dtype == (np.int32 if f.name in ("episode", "step") else np.float32)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        data.o = before  # type: ignore[misc]


def test_transitions_select() -> None:
    data = Transitions(**fields())
    picked = data.select(np.array([4, 1]))
    assert len(picked) == 2
    np.testing.assert_array_equal(picked.o, data.o[[4, 1]])
    np.testing.assert_array_equal(picked.step, [1, 1])
    assert len(data.select(data.episode == 1)) == 3


@pytest.mark.parametrize("name", ["a", "s_next", "nominal", "hidden", "episode", "step"])
def test_transitions_of_unequal_length(name: str) -> None:
    short = fields()[name][:-1]
    with pytest.raises(DataError, match=f"'{name}' has 5 rows and 'o' has 6"):
        Transitions(**fields(**{name: short}))


@pytest.mark.parametrize("name", ["o", "a", "s_next", "nominal"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_transitions_that_exploded(name: str, bad: float) -> None:
    values = fields()[name]
    values[4, 0] = bad
    with pytest.raises(DataError, match=f"'{name}' is not finite at row 4"):
        Transitions(**fields(**{name: values}))


def test_pairs() -> None:
    real = Transitions(**fields())
    answers = np.ones((N, 2))
    pairs = Pairs(real, answers)
    answers[:] = 0
    assert pairs.sim_next.min() == 1
    assert not pairs.sim_next.flags.writeable
    assert len(pairs) == N
    with pytest.raises(DataError, match=r"\(6, 1\).*\(6, 2\)"):
        Pairs(real, np.ones((N, 1)))


def test_spec_counts_its_channels() -> None:
    q, v, last = Channel("qpos/j", "rad"), Channel("qvel/j", "rad/s"), Channel("last/j", "rad")
    spec = TransitionSpec("toy", 50.0, ("j",), (q, v, last), 2, (Channel("ctrl/j", "rad"),))
    assert (spec.n_obs, spec.n_action) == (3, 1)
    assert spec.state == (q, v)
    assert spec.hidden == ()


def test_recording_measures() -> None:
    r = recording()
    assert len(r) == 201
    assert r.seconds == pytest.approx(4.0)
    assert r.rate_hz == pytest.approx(50.0)
    for array in (r.t, *r.columns.values()):
        assert array.dtype == np.float64
        assert not array.flags.writeable


def test_recording_owns_its_columns() -> None:
    column = np.zeros(201)
    columns = {"ctrl/m": column}
    r = recording(columns=columns)
    column[:] = 1
    columns["qpos/late"] = column
    assert list(r.columns) == ["ctrl/m"]
    assert not r.columns["ctrl/m"].any()


def test_recording_lets_samples_be_missing() -> None:
    column = np.full(201, np.nan)
    assert np.isnan(recording(columns={"ctrl/m": column}).columns["ctrl/m"]).all()


@pytest.mark.parametrize(
    ("row", "value"), [(100, 1.0), (100, np.nan), (200, np.inf), (1, 0.0), (200, 3.98)]
)
def test_time_that_does_not_increase(row: int, value: float) -> None:
    t = np.linspace(0, 4, 201)
    t[row] = value
    with pytest.raises(RecordingError, match=f"'t' does not increase at row {row} ") as caught:
        recording(t=t)
    assert "\n" not in str(caught.value)


def test_too_short_a_recording() -> None:
    t = np.linspace(0, 1.99, 201)
    with pytest.raises(RecordingError, match=r"spans 1\.990 s; at least 2 s"):
        recording(t=t)
    with pytest.raises(RecordingError, match="at least two samples"):
        recording(t=t[:1], columns={"ctrl/m": t[:1]})


def test_recording_of_unequal_length() -> None:
    columns = {"ctrl/m": np.zeros(201), "qpos/j": np.zeros(200)}
    with pytest.raises(RecordingError, match="'qpos/j' has 200 samples, 't' has 201"):
        recording(columns=columns)


def test_recording_without_commands() -> None:
    """A machine without actuators has none."""
    assert len(recording(columns={"qpos/j": np.zeros(201)})) == 201
    with pytest.raises(RecordingError, match="no 'ctrl/<actuator>' and no 'qpos/<joint>' column"):
        recording(columns={"sensor/imu/0": np.zeros(201)})
