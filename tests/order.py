"""In which order and company test files run on several workers.

A file runs on one worker, which sets up once what its tests share. What takes long starts first:
else one worker is left alone with it in the end.
"""

from __future__ import annotations

import pytest
from xdist.scheduler import LoadFileScheduling

TOGETHER = "tests/end_to_end"
"""A folder whose files look at one and the same run of a minute, so one worker takes them all."""
LONG = (
    TOGETHER,
    "tests/cli/test_prove.py",
    "tests/deploy/test_loopback.py",
    "tests/diagnose/test_floating.py",
    "tests/physics/test_ray.py",
    "tests/test_examples.py",
    "tests/prove/test_bench.py",
    "tests/test_docs.py",
    "tests/train/test_fit.py",
    "tests/train/test_streamed.py",
    "tests/worlds/test_spread.py",
    "tests/diagnose/observed/test_forces.py",
    "tests/prove/test_replay.py",
    "tests/locomotion/test_train.py",
    "tests/prove/test_world.py",
    "tests/diagnose/recordings/test_odometry.py",
    "tests/studio/test_browser.py",
    "tests/mjcf/test_physics.py",
    "tests/prove/test_legged_laws.py",
    "tests/diagnose/selection/test_lookalikes.py",
    "tests/ask/test_plan.py",
    "tests/ask/test_design.py",
    "tests/passport/test_add.py",
    "tests/passport/test_levels.py",
    "tests/cli/test_diagnose.py",
    "tests/passport/test_drift.py",
    "tests/diagnose/selection/test_in_turn.py",
    "tests/prove/test_legged.py",
    "tests/check/test_faults.py",
    "tests/diagnose/unknown/test_force.py",
    "tests/diagnose/experiment/test_excite.py",
)
"""What takes over 20 s, longest first, by ``pytest --durations=0``."""


def unit(nodeid: str) -> str:
    """What one worker takes as a whole."""
    file = nodeid.split("::", 1)[0]
    return TOGETHER if file.startswith(f"{TOGETHER}/") else file


class ByUnit(LoadFileScheduling):
    """Hands out units in the order in which they were collected."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> ByUnit:
    """Have workers ask for units."""
    config.option.loadscopereorder = False
    return ByUnit(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put what takes long first."""
    gone = [name for name in LONG if not (config.rootpath / name).exists()]
    assert not gone, f"no such tests: {gone}"
    place = {name: i for i, name in enumerate(LONG)}
    items.sort(key=lambda item: place.get(unit(item.nodeid), len(place)))
