"""Rollouts of a linear world whose errors are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from tests.baselines.toy import DT, REAL, SIM, Toy
from wt.baselines.base import find
from wt.config import Baselines
from wt.evaluate.alignment import corrected_action
from wt.evaluate.multi_step import Now, of_baseline, roll_out, simulator
from wt.types import Domain
from wt.worlds.closed_loop import ClosedLoop, ReferenceRollouts

PAST, HORIZON, N = 3, 12, 5
Array = np.ndarray


class Loop:
    """The toy with a policy a = −q / 2 and a force that is hidden and constant."""

    spec = Toy(0.0).spec

    def act(self, o: Array, context: Array) -> Array:
        return -0.5 * o[:, :2] + context

    def advance(self, domain: Domain, o: Array, a: Array, hidden: Array) -> tuple[Array, Array]:
        plant = SIM if domain == "sim" else REAL
        s = plant.step(*(x.astype(float) for x in (o[:, :4], a, hidden)))
        return s.astype(np.float32), hidden.copy()

    def sim_step(self, o: Array, a: Array, hidden: Array | None) -> Array:
        return self.advance("sim", o, a, np.zeros((len(o), 2)) if hidden is None else hidden)[0]

    def stance(self, answer: Array, target: Array, hidden: Array) -> Array:
        return hidden + (target - answer)[:, :2]

    def astray(self, s: Array, hidden: Array) -> Array:
        return ~(np.abs(s) < 50.0).all(axis=1)

    def truth(self, count: int, past: int, horizon: int, seed: int) -> ReferenceRollouts:
        rng = np.random.default_rng(seed)
        o = rng.normal(size=(count, 6)).astype(np.float32)
        force = rng.normal(size=(count, 2)).astype(np.float32)
        context = rng.normal(size=(count, past + horizon, 2)).astype(np.float32)
        seen, acted = [o], []
        for k in range(past + horizon):
            a = self.act(o, context[:, k]).astype(np.float32)
            s, _ = self.advance("real", o, a, force)
            o = np.hstack([s, a])
            seen.append(o)
            acted.append(a)
        hidden = np.repeat(force[:, None], past + horizon + 1, axis=1)
        return ReferenceRollouts(np.stack(seen, 1), np.stack(acted, 1), hidden, context, past)


LOOP = Loop()
TRUTH = LOOP.truth(N, PAST, HORIZON, 0)
ONES = np.ones(4)


def of_real(now: Now) -> Array:
    """Knows R, and the hidden force."""
    return LOOP.advance("real", now.o[:, -1], now.a[:, -1], TRUTH.hidden[:, PAST])[0]


def test_the_toy_is_a_closed_loop() -> None:
    assert isinstance(LOOP, ClosedLoop)
    assert TRUTH.horizon == HORIZON


def test_who_knows_r_makes_no_error() -> None:
    rolled = roll_out(LOOP, TRUTH, of_real, ONES)
    assert np.max(rolled.mse) < 1e-8
    assert not rolled.diverged.any()


def test_rawsim_is_s_in_closed_loop() -> None:
    rolled = roll_out(LOOP, TRUTH, simulator, np.full(4, 2.0))
    o = TRUTH.o[:, PAST].astype(float)
    for k in range(HORIZON):
        a = LOOP.act(o, TRUTH.context[:, PAST + k])
        s = SIM.step(o[:, :4], a, TRUTH.hidden[:, PAST])
        o = np.hstack([s, a])
        error = np.mean(((s - TRUTH.o[:, PAST + k + 1, :4]) / 2.0) ** 2)
        assert rolled.mse[k] == pytest.approx(error, rel=1e-4)
        # in the channels' own units, whatever the scale
        assert np.mean(rolled.rmse[k] ** 2) == pytest.approx(4.0 * error, rel=1e-4)


def test_rollouts_that_leave_the_bounds_are_counted_and_left_out() -> None:
    def step(now: Now) -> Array:
        state = of_real(now)
        state[0] += 100.0  # out of bounds at once
        state[1] = np.nan
        return state

    rolled = roll_out(LOOP, TRUTH, step, ONES)
    assert np.allclose(rolled.diverged, 2 / N)
    assert np.max(rolled.mse) < 1e-8
    lost = roll_out(LOOP, TRUTH, lambda now: np.full_like(now.sim_next, 1e9), ONES)
    assert lost.diverged[0] == 1.0
    assert np.isnan(lost.mse).all()


@pytest.mark.parametrize("name", ["DirectPred", "ResDyn", "ResDynSim", "RSSM"])
def test_a_baseline_sees_its_own_rollout_as_history(name: str) -> None:
    """At the first step, where the past is R's, it predicts as on pairs."""
    toy, settings = Toy(0.0), Baselines(width=8, depth=1, steps=5, batch=32, history=PAST)
    baseline = find(name)(toy.spec, settings, 0)
    baseline.train(toy.collect(SIM, 3, 1), toy.collect(REAL, 3, 2))
    step = of_baseline(baseline, LOOP)
    answers = []

    def watched(now: Now) -> Array:
        answers.append(step(now))
        assert now.o.shape[1] == PAST + 1
        return answers[-1].copy()

    roll_out(LOOP, TRUTH, watched, ONES)
    assert len(answers) == HORIZON
    other = TRUTH.o.copy()
    other[:, PAST - 1] += 1.0
    changed = ReferenceRollouts(other, TRUTH.a, TRUTH.hidden, TRUTH.context, PAST)
    first = answers[0]
    answers.clear()
    roll_out(LOOP, changed, watched, ONES)
    reads_history = name != "DirectPred"
    assert np.allclose(answers[0], first) != reads_history


def test_the_corrected_action_reaches_a_target_that_can_be_reached() -> None:
    o, hidden = TRUTH.o[:, 0], TRUTH.hidden[:, 0]
    a = TRUTH.a[:, 0]
    wanted, _ = LOOP.advance("sim", o, a + 0.1, hidden)
    before, _ = LOOP.advance("sim", o, a, hidden)
    better = corrected_action(
        lambda action: LOOP.advance("sim", o, action, hidden)[0], a, wanted, np.full(4, DT)
    )
    after, _ = LOOP.advance("sim", o, better, hidden)
    # damped on purpose: most of the way, and no further
    assert np.abs(after - wanted).max() < 0.5 * np.abs(before - wanted).max()
    assert (better > a).all()
    assert (better < a + 0.1 + 1e-5).all()


def test_with_corrected_actions_the_state_is_the_simulators_own() -> None:
    plain = roll_out(LOOP, TRUTH, simulator, ONES)
    corrected = roll_out(LOOP, TRUTH, of_real, ONES, "action")
    # one actuator a joint cannot follow everything, but R's own path is followed better than by S
    assert 0.0 < corrected.mse[-1] < plain.mse[-1]


def test_what_is_hidden_follows_standing_feet_where_that_is_asked_for() -> None:
    def moved(now: Now) -> Array:
        return now.sim_next + np.float32(0.1)

    plain, stance = (roll_out(LOOP, TRUTH, moved, ONES, x) for x in ("state", "stance"))
    assert stance.mse[0] == plain.mse[0]  # it is the next step that starts elsewhere
    assert np.all(stance.mse[1:] != plain.mse[1:])


@pytest.mark.parametrize("true_hidden", [True, False])
def test_hidden_state_is_r_s_own_at_every_step_where_asked_for(true_hidden: bool) -> None:
    """A translation far off drags hidden state along, unless that is R's own."""
    asked = []

    def step(now: Now) -> Array:
        truly = LOOP.advance("sim", now.o[:, -1], now.a[:, -1], TRUTH.hidden[:, PAST])[0]
        asked.append(np.allclose(now.sim_next, truly, atol=1e-5))
        return now.sim_next + 0.1

    roll_out(LOOP, TRUTH, step, ONES, "stance", true_hidden)
    assert asked[0]
    assert all(asked[1:]) if true_hidden else not any(asked[1:])
