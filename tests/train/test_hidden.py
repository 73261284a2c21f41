"""A cart whose velocity no sensor tells, and shows in where it is before and after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wt.config import Mean
from wt.nets.frame import Frame
from wt.nets.mlp import mlp
from wt.train.hidden import HiddenEstimator
from wt.train.mean_field import fit_normalizers
from wt.train.regression import Regression
from wt.types import Channel, Transitions, TransitionSpec

DT, LENGTH = 0.1, 40
SPEC = TransitionSpec(
    task="cart",
    rate_hz=1 / DT,
    joints=("lever",),
    observation=(Channel("place", "m"), Channel("pull", "N"), Channel("last", "rad")),
    n_state=2,
    action=(Channel("ctrl", "rad"),),
    hidden=(Channel("velocity", "m/s"), Channel("heading", "rad")),
)


def cart(episodes: int, seed: int, drags: tuple[float, float] = (1.0, 1.0)) -> Transitions:
    """Place p′ = p + dt v; what is pulled at is −drag v; v is an autoregressive process.

    Each episode has a drag of its own, between the two that are given.
    """
    rng = np.random.default_rng(seed)
    v, p = rng.normal(size=episodes), np.zeros(episodes)
    drag = np.random.default_rng((seed, 1)).uniform(*drags, episodes)
    pull, last = -drag * v, np.zeros(episodes)
    heading, rows = rng.uniform(-np.pi, np.pi, episodes), []
    for _ in range(LENGTH):
        a = rng.normal(size=episodes)
        o, hidden = np.stack([p, pull, last], 1), np.stack([v, heading], 1)
        p = p + DT * v
        v = 0.9 * v + np.sqrt(1 - 0.81) * rng.normal(size=episodes)
        pull, last = -drag * v, a
        rows.append((o, a[:, None], np.stack([p, pull], 1), hidden))
    o, a, after, hidden = (
        np.stack(x, 1).reshape(episodes * LENGTH, -1) for x in zip(*rows, strict=True)
    )
    index = np.arange(len(o))
    return Transitions(
        o=o, a=a, s_next=after, nominal=after, hidden=hidden, episode=index // LENGTH,
        step=index % LENGTH,
    )  # fmt: skip


@pytest.fixture(scope="module")
def estimator() -> HiddenEstimator:
    sim, real = cart(150, 1), cart(150, 2)
    frame = Frame(SPEC, Mean())
    fit_normalizers(frame, sim, real)
    made = HiddenEstimator(frame, lambda n, m: mlp(n, m, 64, 2), Regression(600, 256, 4e-3))
    made.fit(sim, replace(real, hidden=np.full_like(real.hidden, np.nan)))
    return made


def test_motion_shows_in_the_recording_up_to_its_ends(estimator: HiddenEstimator) -> None:
    real = cart(20, 3)
    told = estimator.estimate(replace(real, hidden=np.full_like(real.hidden, np.nan)))
    assert told is not None
    off = told[:, 0] - real.hidden[:, 0]
    assert np.sqrt(np.mean(off**2)) < 0.15
    ends = np.isin(real.step, (0, LENGTH - 1))
    assert np.sqrt(np.mean(off[ends] ** 2)) < 0.2


def test_lessons_around_s_leave_what_holds_in_s_alone() -> None:
    sim, real = cart(150, 1), cart(150, 2, drags=(1.5, 1.5))
    frame = Frame(SPEC, Mean())
    fit_normalizers(frame, sim, real)
    unseen, off = replace(real, hidden=np.full_like(real.hidden, np.nan)), list[float]()
    for lessons in (None, cart(150, 3, drags=(0.6, 1.7))):
        made = HiddenEstimator(frame, lambda n, m: mlp(n, m, 64, 2), Regression(600, 256, 4e-3))
        made.fit(sim, unseen, lessons=lessons)
        told = made.estimate(unseen)
        assert told is not None
        off.append(float(np.sqrt(np.mean((told - real.hidden)[:, 0] ** 2))))
    assert off[1] < 0.5 * off[0]


def test_what_nothing_shows_is_the_simulators_average(estimator: HiddenEstimator) -> None:
    told, sim = estimator.estimate(cart(20, 3)), cart(150, 1)
    assert told is not None
    assert np.allclose(told[:, 1], sim.hidden[:, 1].mean(), atol=1e-5)


def test_no_step_is_read_beyond_its_episode(estimator: HiddenEstimator) -> None:
    real, first = cart(3, 4), np.arange(LENGTH)
    alone, beside = estimator.estimate(real.select(first)), estimator.estimate(real)
    assert alone is not None
    assert beside is not None
    np.testing.assert_allclose(alone, beside[:LENGTH], atol=1e-5)


def test_nothing_hidden_nothing_estimated() -> None:
    frame = Frame(replace(SPEC, hidden=()), Mean())
    estimator = HiddenEstimator(frame, lambda n, m: mlp(n, m, 8, 1), Regression(5, 8, 1e-3))
    data = replace(cart(2, 0), hidden=np.empty((2 * LENGTH, 0)))
    estimator.fit(data, data)
    assert estimator.regressions == 0
    assert estimator.estimate(data) is None
