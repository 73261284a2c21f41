"""When feet stand and swing, against a rhythm written out by hand."""

from __future__ import annotations

import numpy as np

from wt.worlds.gait import Gait, GaitClock, moving


def test_two_feet_take_turns() -> None:
    # T = 1 s, stance 0.6: the first foot swings from 0.6 to 1.0 s, the second from 0.1 to 0.5 s
    time = np.array([0.0, 0.3, 0.55, 0.7, 0.9, 1.3])
    swing = Gait(period=1.0, stance=0.6).swing(time, (0.0, 0.5))
    wanted = [[-1, -1], [-1, 0.5], [-1, -1], [0.25, -1], [0.75, -1], [-1, 0.5]]
    np.testing.assert_allclose(swing, wanted, atol=1e-6)


def test_the_clock_turns_once_a_period_for_those_who_are_told_to_move() -> None:
    command = np.array([[0.5, 0, 0], [0, 0, -0.2], [0, 0.05, 0]])
    np.testing.assert_array_equal(moving(command), [True, True, False])
    clock = GaitClock(0.8, 3)
    seen = clock.read(np.array([0.2, 0.8 + 0.4, 0.2]), command)
    np.testing.assert_allclose(seen, [[1, 0], [0, -1], [0, 0]], atol=1e-6)
    np.testing.assert_array_equal(clock.running, [True, True, False])


def test_the_clock_runs_on_for_a_last_period_to_a_step_s_end() -> None:
    clock, go, stop = GaitClock(1.0, 1), np.array([[0.5, 0, 0]]), np.zeros((1, 3))
    ran = []
    for k in range(60):  # told to stop at 1.2 s: on to 1.5 s, 1.05 periods more
        clock.read(np.array([0.05 * k]), go if k < 24 else stop)
        ran.append(bool(clock.running[0]))
    assert ran == [True] * 51 + [False] * 9


def test_who_starts_anew_has_no_step_to_end() -> None:
    clock, go, stop = GaitClock(1.0, 1), np.array([[0.5, 0, 0]]), np.zeros((1, 3))
    clock.read(np.array([3.1]), go)
    assert not clock.read(np.array([0.0]), stop).any()


def test_a_clock_that_never_rests_runs_where_the_robot_is_told_to_stand() -> None:
    clock = GaitClock(1.0, 1, rests=False)
    np.testing.assert_allclose(clock.read(np.array([0.25]), np.zeros((1, 3))), [[1, 0]], atol=1e-6)
    assert clock.running.all()


def test_without_a_rhythm_there_is_nothing_to_see() -> None:
    clock = GaitClock(None, 2)
    assert clock.read(np.zeros(2), np.array([[0.5, 0, 0], [0, 0, 0]])).shape == (2, 0)
    np.testing.assert_array_equal(clock.running, [True, False])
