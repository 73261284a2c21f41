from __future__ import annotations

import pytest

from tests.baselines.toy import REAL, SIM, Toy, Trial
from wt.baselines.base import find
from wt.config import Baselines


def fitted_error(name: str, trial: Trial, settings: Baselines) -> float:
    baseline = find(name)(trial.toy.spec, settings, 0)
    baseline.train(trial.sim, trial.real)
    return trial.error(baseline.predict(trial.test))


def test_history_tells_a_force_that_stays(persistent: Trial, small: Baselines) -> None:
    error = fitted_error("ResDyn", persistent, small)
    assert error < 0.4 * persistent.toy.error_without_history()
    assert error > 0.9 * persistent.toy.error_with_history()


def test_history_tells_nothing_of_a_fleeting_force(fleeting: Trial, small: Baselines) -> None:
    error = fitted_error("ResDyn", fleeting, small)
    assert error == pytest.approx(fleeting.toy.error_without_history(), rel=0.15)


def test_simulator_output_tells_a_fleeting_force(fleeting: Trial, small: Baselines) -> None:
    # the force acts by dt/m: the simulator's part of it is added whole, so what is left is
    # at best the difference of the two masses' effects
    error = fitted_error("ResDynSim", fleeting, small)
    assert error < 0.5 * fitted_error("ResDyn", fleeting, small)


def test_test_time_base_is_the_simulator_under_the_true_force() -> None:
    toy = Toy(0.9)
    settings = Baselines(width=8, depth=1, steps=1, batch=16, history=2, learning_rate=1e-9)
    test = toy.pairs(2, 5)
    for name, base in (("ResDyn", test.real.nominal), ("ResDynSim", test.sim_next)):
        baseline = find(name)(toy.spec, settings, 0)
        baseline.train(toy.collect(SIM, 2, 1), toy.collect(REAL, 2, 2))
        for parameter in baseline.net.parameters():
            parameter.data.zero_()
        assert baseline.predict(test) == pytest.approx(base, abs=1e-5)
