"""Rollouts of a linear world whose errors are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from tests.baselines.toy import DT, REAL, SIM, Toy
from wt.baselines.base import find
from wt.config import Baselines, Mean, Method, Nets
from wt.evaluate.alignment import corrected_action
from wt.evaluate.multi_step import (
    Carrying,
    Now,
    Paths,
    disturbed,
    follow,
    middle,
    of_baseline,
    of_model,
    roll_out,
    score,
    simulator,
    still,
)
from wt.nets.world_model import WorldModel
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


def test_r_itself_is_followed_where_r_answers() -> None:
    rolled = score(follow(LOOP, TRUTH, simulator, ONES, domain="real"), TRUTH, ONES)
    assert np.max(rolled.mse) < 1e-8
    np.testing.assert_allclose(rolled.amplitude, 1.0, rtol=1e-3)
    np.testing.assert_allclose(rolled.correlation, 1.0, rtol=1e-3)


def test_amplitude_and_correlation_are_those_of_predictions_and_r() -> None:
    """Predictions that keep to half of what R does: their square error is that of the rest."""
    real = TRUTH.o[:, PAST + 1 :, :4].astype(float)
    middling = real.mean(axis=0)
    nobody = np.zeros(real.shape[:2], bool)
    half = score(Paths(middling + 0.5 * (real - middling), nobody), TRUTH, ONES)
    np.testing.assert_allclose(half.amplitude, 0.25, rtol=1e-4)
    np.testing.assert_allclose(half.correlation, 1.0, rtol=1e-4)
    np.testing.assert_allclose(half.mse, 0.25 * real.var(axis=0).mean(axis=1), rtol=1e-4)
    other = score(Paths(middling - (real - middling), nobody), TRUTH, ONES)
    np.testing.assert_allclose(other.correlation, -1.0, rtol=1e-4)
    # who always says the same is not correlated with anything
    mean = real.mean(axis=(0, 1))
    always = score(still(TRUTH, mean), TRUTH, ONES)
    assert np.isnan(always.correlation).all() and np.max(always.amplitude) < 1e-9
    np.testing.assert_allclose(always.mse, ((real - mean) ** 2).mean(axis=(0, 2)), rtol=1e-5)


def test_the_mean_of_rollouts_is_of_those_that_all_stay() -> None:
    one, two = (
        Paths(np.full((N, HORIZON, 4), value), np.zeros((N, HORIZON), bool)) for value in (1.0, 4.0)
    )
    two.gone[1, 3:] = True
    mean = middle([one, two])
    assert (mean.states == 2.5).all()
    assert mean.gone.sum() == HORIZON - 3 and mean.gone[1, 3]


def test_a_disturbed_method_is_off_by_errors_that_are_drawn() -> None:
    errors = np.array([[0.5, 0, 0, 0], [0, 0, 0, -2.0]])
    drawn = []

    def watched(now: Now) -> Array:
        state = disturbed_step(now)
        drawn.append(state - of_real(now))
        return state

    disturbed_step = disturbed(of_real, errors, 0)
    roll_out(LOOP, TRUTH, watched, ONES)
    found = np.concatenate(drawn)
    known = np.abs(found[:, None] - errors).max(axis=2).min(axis=1)
    assert known.max() < 1e-5  # each one is one of them
    share = float((found[:, 0] > 0.25).mean())
    assert 0.25 < share < 0.75  # and both are
    again = disturbed(of_real, errors, 0)
    now = Now(TRUTH.o[:, : PAST + 1], TRUTH.a[:, : PAST + 1], TRUTH.o[:, PAST, :4])
    np.testing.assert_allclose(again(now) - of_real(now), drawn[0], atol=1e-5)


def test_a_disturbed_method_carries_on_what_it_carried_on() -> None:
    class Sure:
        def __call__(self, now: Now) -> Array:
            return of_real(now)

        def hidden(self, now: Now, before: Array, after: Array) -> Array:
            return after + 1.0

    nothing, now = np.zeros((1, 4)), Now(TRUTH.o[:, :1], TRUTH.a[:, :1], TRUTH.o[:, 0, :4])
    zero = np.zeros((N, 2))
    step = disturbed(Sure(), nothing, 0)
    assert isinstance(step, Carrying) and (step.hidden(now, zero, zero) == 1.0).all()
    plain = disturbed(of_real, nothing, 0)
    assert isinstance(plain, Carrying) and (plain.hidden(now, zero, zero) == 0.0).all()


def test_what_is_hidden_is_left_to_s_where_that_is_asked_for() -> None:
    small = Method(mean=Mean(width=4, depth=1), nets=Nets(latent=2, width=4, depth=1))
    model = WorldModel(LOOP.spec, small)
    assert isinstance(of_model(model), Carrying)
    assert not isinstance(of_model(model, carry=False), Carrying)
