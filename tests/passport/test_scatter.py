"""Scatter of values about the means of their cells."""

from __future__ import annotations

import numpy as np
import pytest

from wt.passport.scatter import Scattered, profile


def test_one_value_that_is_known_tells_nothing_of_scatter() -> None:
    # of the other of each cell nothing is known, so that weights are all of one
    alone = Scattered(np.array([0, 0, 1, 1]), np.arange(4.0), np.array([1e-4, 1e30, 1e30, 1e-4]))
    assert alone.freedom == 2 and alone.variance == 0.0
    assert profile(alone).value == 0.0


def test_scatter_beyond_the_errors_is_found() -> None:
    rng = np.random.default_rng(0)
    cell = np.repeat(np.arange(200), 4)
    value = 3.0 * cell + rng.normal(0.0, np.hypot(1.0, 2.0), cell.shape)
    found = profile(Scattered(cell, value, np.ones(cell.shape)))
    assert found.value == pytest.approx(2.0, rel=0.1)
    assert found.low < 2.0 < found.high
