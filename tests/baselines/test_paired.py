from __future__ import annotations

import pytest

from tests.baselines.toy import Trial
from wt.config import Baselines
from wt.evaluate.results import CEILING


@pytest.mark.parametrize("world", ["persistent", "fleeting"])
def test_undoes_the_gap_whatever_a_history_tells(
    world: str, small: Baselines, request: pytest.FixtureRequest
) -> None:
    # S's answer and (o, a) give the force away, and R's outcome is linear in all three
    trial: Trial = request.getfixturevalue(world)
    ceiling = trial.fitted(CEILING, small)
    assert trial.error(ceiling.predict(trial.test)) < 0.05 * trial.toy.error_with_history()
