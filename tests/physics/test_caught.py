"""Errors that MuJoCo raises in a step, and not warnings, are raised in Python instead."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.errors import WorkError
from wt.physics.caught import Landing, step_address
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

BALLS = 40
SMALL, LARGE = "6K", "10M"  # room for the model, but none to look for contacts; and for both
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3)


def pile(memory: str) -> str:
    """Balls that slide up and down, and rest on the floor."""
    balls = "".join(
        f'<body pos="{i} 0 .09"><joint name="up{i}" type="slide" axis="0 0 1"/>'
        '<geom size=".1"/></body>'
        for i in range(BALLS)
    )
    floor = '<geom type="plane" size="5 5 1"/>'
    return f'<mujoco><size memory="{memory}"/><worldbody>{balls}{floor}</worldbody></mujoco>'


def stepped(model: mujoco.MjModel, data: mujoco.MjData, landing: Landing) -> int:
    return int(_STEP(step_address())(model._address, data._address, landing.address))


def replayed(path: Path, memory: str, law: str) -> np.ndarray:
    path.write_text(pile(memory))
    scene, t = Scene(path), np.arange(50) * 0.01
    stretch = Stretch(0, t, np.zeros((50, 0)), np.zeros(BALLS), np.zeros(BALLS))
    effect = effects()[law]
    planted = Planted(effect, Location("joint", "up0"), np.ones(len(effect.bounds()[0])))
    return Replayer(scene, [stretch], 2e-3).run([(planted,)]).q


def test_a_step_that_fails_says_why_and_another_works() -> None:
    small, large = (mujoco.MjModel.from_xml_string(pile(memory)) for memory in (SMALL, LARGE))
    landing = Landing()
    with pytest.raises(mujoco.FatalError) as known:  # as the bindings raise it
        mujoco.mj_step(small, mujoco.MjData(small))
    assert stepped(small, mujoco.MjData(small), landing) != 0
    assert landing.said()[:30] == str(known.value)[:30]
    data, same = mujoco.MjData(large), mujoco.MjData(large)
    assert stepped(large, data, landing) == 0
    mujoco.mj_step(large, same)
    np.testing.assert_array_equal(data.qpos, same.qpos)


def test_each_thread_has_its_own_landing() -> None:
    small, large = (mujoco.MjModel.from_xml_string(pile(memory)) for memory in (SMALL, LARGE))

    def run(i: int) -> bool:
        model, landing = (small, large)[i % 2], Landing()
        data = mujoco.MjData(model)
        failed = [stepped(model, data, landing) != 0 for _ in range(50)]
        return all(failed) if model is small else not any(failed)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(run, range(16)))


@pytest.mark.parametrize("law", ["joint.friction_viscous", "joint.friction_directional"])
def test_a_replay_that_cannot_be_stepped_is_one_line(tmp_path: Path, law: str) -> None:
    assert np.isfinite(replayed(tmp_path / "large.xml", LARGE, law)).all()
    with pytest.raises(WorkError, match=r"MuJoCo cannot step this model: .*memory") as error:
        replayed(tmp_path / "small.xml", SMALL, law)
    assert "\n" not in str(error.value)


def test_threads_that_ask_at_once_get_the_same_step() -> None:
    code = (
        "from concurrent.futures import ThreadPoolExecutor\n"
        "from wt.physics.caught import step_address\n"
        "with ThreadPoolExecutor(8) as pool:\n"
        "    assert len(set(pool.map(lambda _: step_address(), range(64)))) == 1\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
