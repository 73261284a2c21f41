from __future__ import annotations

import numpy as np

from tests.baselines.toy import SIM, Trial
from wt.baselines.base import find
from wt.config import Baselines


def test_is_the_simulator_under_the_true_force(persistent: Trial, small: Baselines) -> None:
    raw = find("RawSim")(persistent.toy.spec, small, 0)
    raw.train(persistent.sim, persistent.real)
    predicted = raw.predict(persistent.test)
    real = persistent.test.real
    # v_next = v + dt (kp (a - q) - kv v + f) / m with S's numbers, one row by hand
    q, v, a, f = real.o[7, 0], real.o[7, 2], real.a[7, 0], real.hidden[7, 0]
    after = v + 0.1 * (8.0 * (a - q) - 3.0 * v + f) / 1.0
    np.testing.assert_allclose(predicted[7, 2], after, rtol=1e-5)
    np.testing.assert_allclose(predicted[7, 0], q + 0.1 * after, rtol=1e-5)
    assert persistent.error(SIM.step(real.o[:, :4], real.a, real.hidden)) > 0.0
