from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.baselines.toy import REAL, SIM, Field, Toy, Trial
from wt.baselines.base import find
from wt.config import Baselines
from wt.train.hidden import HiddenEstimator
from wt.train.regression import Progress
from wt.train.selection import Unpaired
from wt.types import Pairs, Transitions


@pytest.mark.parametrize("world", ["persistent", "fleeting"])
def test_tells_what_no_history_does(
    world: str, small: Baselines, request: pytest.FixtureRequest
) -> None:
    # a force that acts all the time has no most frequent absence: (o, a) give some of it away
    trial: Trial = request.getfixturevalue(world)
    error = trial.error(trial.fitted("SimulatorEncoder", small).predict(trial.test))
    best = trial.toy.error_without_history() if world == "persistent" else 0.0
    assert error < 0.05 * trial.toy.error_without_history() + 0.5 * best


def test_what_the_collection_knows_of_the_robot_is_never_read() -> None:
    toy, settings = Toy(0.5), Baselines(width=8, depth=1, steps=20, batch=32, learning_rate=0.1)
    test, answers = toy.pairs(2, 3), []

    def poisoned(data: Transitions) -> Transitions:
        return replace(data, hidden=np.full_like(data.hidden, np.nan))

    for real_of in (lambda data: data, poisoned):
        real, held = real_of(toy.collect(REAL, 3, 2)), real_of(toy.collect(REAL, 2, 5))
        baseline = find("SimulatorEncoder")(toy.spec, settings, 0, toy)
        baseline.train(toy.collect(SIM, 3, 1), real, Unpaired(toy.collect(SIM, 2, 4), held))
        answers.append(baseline.predict(test))
    assert np.array_equal(*answers)


def test_corrects_the_plain_answer_where_nothing_is_hidden(small: Baselines) -> None:
    toy = Toy(0.0)
    still = replace(toy.spec, hidden=())
    sim, real = (
        replace(data, s_next=plant.step(np.float64(data.o[:, :4]), data.a, 0.0 * data.a),
                hidden=np.empty((len(data), 0)))
        for plant, data in ((SIM, toy.collect(SIM, 60, 1)), (REAL, toy.collect(REAL, 60, 2)))
    )  # fmt: skip
    baseline = find("SimulatorEncoder")(still, small, 0, toy)
    baseline.train(sim, real)
    test = toy.pairs(10, 3)
    test = replace(test, real=real.select(np.arange(600)), sim_next=real.nominal[:600])
    left = np.mean((baseline.predict(test) - test.real.s_next) ** 2)
    assert left < 0.01 * np.mean((test.sim_next - test.real.s_next) ** 2)


def test_what_no_recording_tells_is_taken_from_s(small: Baselines) -> None:
    # f of S's answers elsewhere learns to take back what S says of the ground: an error of all that
    # it does, and more
    field = Field(0.0)
    held = Unpaired(field.collect(SIM, 60, 4), field.collect(REAL, 60, 5))
    baseline = find("SimulatorEncoder")(field.spec, small, 0, field)
    baseline.train(field.collect(SIM, 100, 1), field.collect(REAL, 100, 2), held)
    real = field.collect(REAL, 30, 3)
    test = Pairs(real, field.sim_step(real.o, real.a, real.hidden))
    error = (baseline.predict(test) - real.s_next)[:, 2:]
    pushed = (real.s_next - REAL.step(np.float64(real.o[:, :4]), real.a, 0 * real.hidden))[:, 2:]
    assert np.mean(error**2) < 0.3 * np.mean(pushed**2)


def test_estimates_are_taught_by_lessons(monkeypatch: pytest.MonkeyPatch) -> None:
    toy, given = Toy(0.5), list[object]()
    fit = HiddenEstimator.fit

    def watched(
        self: HiddenEstimator,
        sim: Transitions,
        real: Transitions,
        _: Progress | None,
        *,
        lessons: Transitions | None,
    ) -> None:
        given.append(lessons)
        fit(self, sim, real, lessons=lessons)

    monkeypatch.setattr(HiddenEstimator, "fit", watched)
    sim, real, around = (toy.collect(plant, 3, k) for k, plant in enumerate((SIM, REAL, SIM)))
    settings = Baselines(width=8, depth=1, steps=5, batch=16)
    find("SimulatorEncoder")(toy.spec, settings, 0, toy, None, around).train(sim, real)
    assert given == [around]
