"""A tether whose pull hardly changes."""

from __future__ import annotations

import numpy as np
import pytest

from wt.physics.effect import effects


def test_a_pull_that_does_not_change_is_kept_by_an_anchor_far_away() -> None:
    tether = effects()["body.tether"]
    lower, upper = tether.bounds()
    for k in (0.0, 0.1, 30.0):
        coefficients = np.array([k, 9.0, -3.0, 6.0])
        stiffness, *anchor = np.clip(tether.theta(coefficients, ()), lower, upper)
        assert stiffness >= k
        assert stiffness * np.array(anchor) == pytest.approx(coefficients[1:])
