from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.baselines.toy import DT, REAL, SIM, Trial
from wt.config import Baselines


def test_finds_the_action_under_which_the_simulator_does_what_the_robot_does(
    persistent: Trial, small: Baselines
) -> None:
    # without a force S and R end alike where kp' (a' - q) - kv' v = (kp (a - q) - kv v) m' / m
    still = replace(persistent.test.real, hidden=0.0 * persistent.test.real.hidden)
    q, v = np.split(np.float64(still.o[:, :4]), 2, axis=1)
    wanted = (REAL.kp * (still.a - q) - REAL.kv * v) / REAL.mass
    right = q + (wanted * SIM.mass + SIM.kv * v) / SIM.kp
    baseline = persistent.fitted("DeltaAction", small)
    predicted = baseline.predict(replace(persistent.test, real=still))
    # S's velocity tells the action that it was given
    given = q + ((predicted[:, 2:] - v) / DT * SIM.mass + SIM.kv * v) / SIM.kp
    off = np.sqrt(np.mean((given - right) ** 2))
    assert off < 0.25 * np.sqrt(np.mean((still.a - right) ** 2))


def test_what_the_simulator_is_given_stays_in_its_answer(fleeting: Trial, small: Baselines) -> None:
    # the force acts in S as R has it, but for the masses: nothing that sees (o, a) alone has that
    error = fleeting.error(fleeting.fitted("DeltaAction", small).predict(fleeting.test))
    left = (1 / SIM.mass - 1 / REAL.mass) ** 2 * DT**2
    assert error == pytest.approx(left, rel=0.8)
    assert error < 0.5 * fleeting.toy.error_without_history()
    assert error < 0.1 * fleeting.error(fleeting.test.sim_next)
