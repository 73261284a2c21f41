"""``wt.Simulator`` steps what was written as plain MuJoCo and ``physics.py`` do."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import wt
from tests.mjcf.written import drive, load, unhidden, write
from tests.physics.arm import ARM
from wt.errors import UserError
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

DEAD = Planted(effects()["actuator.deadband"], Location("actuator", "m1"), np.array([1.5]))


@pytest.mark.parametrize("hypothesis", [[], [DEAD]], ids=["model", "physics"])
def test_it_steps_the_files(hypothesis: list[Planted], tmp_path: Path) -> None:
    folder, run = write(tmp_path, hypothesis), unhidden(ARM)
    simulator = wt.Simulator(folder)
    u = 0.5 * (run.held + np.vstack([run.held[:1], run.held[:-1]]))
    q = np.empty_like(run.q)
    for k in range(200):
        q[k] = simulator.data.qpos
        simulator.step(u[k])
    np.testing.assert_allclose(q[:200], drive(*load(folder), run)[:200], atol=1e-12)
    simulator.reset()
    assert simulator.data.time == 0.0
    assert mujoco.get_mjcb_passive() is None


def test_a_folder_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"model\.xml"):
        wt.Simulator(tmp_path)
    folder = write(tmp_path, [DEAD])
    (folder / "physics.py").write_text("nonsense(")
    with pytest.raises(UserError, match="does not load"):
        wt.Simulator(folder)
