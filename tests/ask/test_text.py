"""What is said of an experiment before it is run."""

from __future__ import annotations

import numpy as np

from wt.ask.separation import Expected
from wt.ask.text import expectations


def apart(*nats: float) -> Expected:
    """An experiment that tells each rival from what is claimed by so much."""
    matrix = np.zeros((len(nats) + 1, len(nats) + 1))
    matrix[0, 1:] = matrix[1:, 0] = nats
    return Expected(matrix, 7.25)


def test_a_rival_that_will_not_be_told_apart_is_no_reason_to_ask() -> None:
    assert expectations(apart(0.01), ["late sensors"]) == [
        "not expected to tell late sensors from it",
        "expected to make intervals narrower: 7.2 nats of information",
    ]
    assert expectations(apart(3.0, 0.0), ["play", "late sensors"]) == [
        "expected to tell play from it by odds of 20 to 1",
        "not expected to tell late sensors from it",
    ]
    (only,) = expectations(apart(), [])
    assert only.startswith("expected to make intervals narrower")
