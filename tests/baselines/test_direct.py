from __future__ import annotations

import pytest

from tests.baselines.toy import Trial
from wt.baselines.base import find
from wt.config import Baselines


@pytest.mark.parametrize("world", ["persistent", "fleeting"])
def test_reaches_the_bayes_error(
    world: str, small: Baselines, request: pytest.FixtureRequest
) -> None:
    trial: Trial = request.getfixturevalue(world)
    direct = find("DirectPred")(trial.toy.spec, small, 0)
    direct.train(trial.sim, trial.real)
    error = trial.error(direct.predict(trial.test))
    assert error == pytest.approx(trial.toy.error_without_history(), rel=0.15)
