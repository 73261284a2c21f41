"""The step timer is off in our batches, comes back on request, and changes no result."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.batch import Batch, time_steps

XML = "<mujoco><worldbody><body><joint/><geom size='.1' pos='.3 0 0'/></body></worldbody></mujoco>"


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def duration(model: mujoco.MjModel) -> float:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    return float(data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration)


def test_a_batch_switches_the_timer_off_and_who_asks_has_it_back(model: mujoco.MjModel) -> None:
    time_steps(True)
    assert duration(model) > 0
    Batch(model, 1)
    assert duration(model) == 0
    time_steps(True)
    assert duration(model) > 0


def test_steps_are_the_same_to_the_bit(model: mujoco.MjModel) -> None:
    ends = []
    for timer in (True, False):
        batch = Batch(model, 2, 1)
        time_steps(timer)
        batch.bind("qpos")[:] = [[0.3], [1.0]]
        batch.step(nstep=500)
        ends.append(batch.bind("qpos").copy())
    np.testing.assert_array_equal(*ends)
