"""When feet stand and swing, against a rhythm written out by hand."""

from __future__ import annotations

import numpy as np

from wt.worlds.gait import Gait, clock, moving


def test_two_feet_take_turns() -> None:
    # T = 1 s, stance 0.6: the first foot swings from 0.6 to 1.0 s, the second from 0.1 to 0.5 s
    time = np.array([0.0, 0.3, 0.55, 0.7, 0.9, 1.3])
    swing = Gait(period=1.0, stance=0.6).swing(time, (0.0, 0.5))
    wanted = [[-1, -1], [-1, 0.5], [-1, -1], [0.25, -1], [0.75, -1], [-1, 0.5]]
    np.testing.assert_allclose(swing, wanted, atol=1e-6)


def test_the_clock_turns_once_a_period_and_rests_where_the_robot_is_to_stand() -> None:
    command = np.array([[0.5, 0, 0], [0, 0, -0.2], [0, 0.05, 0]])
    np.testing.assert_array_equal(moving(command), [True, True, False])
    seen = clock(0.8, np.array([0.2, 0.8 + 0.4, 0.2]), command)
    np.testing.assert_allclose(seen, [[1, 0], [0, -1], [0, 0]], atol=1e-6)
