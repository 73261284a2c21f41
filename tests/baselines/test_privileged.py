from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.baselines.toy import Trial
from wt.baselines.base import find
from wt.config import Baselines
from wt.types import Transitions


@pytest.mark.parametrize("world", ["persistent", "fleeting"])
def test_knows_what_no_history_can_tell(
    world: str, small: Baselines, request: pytest.FixtureRequest
) -> None:
    trial: Trial = request.getfixturevalue(world)
    told = find("PrivilegedPred")(trial.toy.spec, small, 0)
    told.train(trial.sim, trial.real)
    assert trial.error(told.predict(trial.test)) < 0.1 * trial.toy.error_with_history()


def test_where_nothing_is_hidden_it_is_direct_prediction(fleeting: Trial, small: Baselines) -> None:
    def bare(data: Transitions) -> Transitions:
        return replace(data, hidden=np.empty((len(data.o), 0), np.float32))

    spec = replace(fleeting.toy.spec, hidden=())
    pairs = replace(fleeting.test, real=bare(fleeting.test.real))
    answers = []
    for name in ("PrivilegedPred", "DirectPred"):
        baseline = find(name)(spec, small, 0)
        baseline.train(bare(fleeting.sim), bare(fleeting.real))
        answers.append(baseline.predict(pairs))
    np.testing.assert_allclose(*answers, rtol=1e-5, atol=1e-6)
