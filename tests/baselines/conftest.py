"""The two toy worlds and the small budget that all baselines' tests share."""

from __future__ import annotations

import pytest

from tests.baselines.toy import Trial, trial
from wt.config import Baselines


@pytest.fixture(scope="session")
def persistent() -> Trial:
    """The force stays: history tells most of it."""
    return trial(0.95)


@pytest.fixture(scope="session")
def fleeting() -> Trial:
    """The force is new at every step: nothing but the simulator can tell it."""
    return trial(0.0)


@pytest.fixture(scope="session")
def small() -> Baselines:
    return Baselines(width=64, depth=2, steps=500, batch=256, learning_rate=4e-3, history=4)
