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
    "tests/deploy/test_loopback.py",
    "tests/passport/test_add.py",
    "tests/train/test_fit.py",
    "tests/diagnose/test_pipeline.py",
    "tests/studio/test_browser.py",
    "tests/ask/test_plan.py",
    "tests/cli/test_diagnose.py",
    "tests/prove/test_bench.py",
    "tests/cli/test_prove.py",
    "tests/ask/test_design.py",
    "tests/finetune/test_trainings.py",
    "tests/finetune/test_job.py",
    "tests/run/test_pool.py",
    "tests/diagnose/likelihood/test_estimate.py",
    "tests/diagnose/unknown/test_remembering.py",
    "tests/physics/test_ray.py",
    "tests/prove/test_rivals.py",
    "tests/diagnose/unknown/test_force.py",
    "tests/prove/test_world.py",
    "tests/worlds/test_policies.py",
    "tests/diagnose/observed/test_forces.py",
    "tests/diagnose/selection/test_lookalikes.py",
    "tests/diagnose/selection/test_addition.py",
    "tests/check/test_faults.py",
    "tests/prove/test_replay.py",
    "tests/mjcf/test_physics.py",
    "tests/train/test_replicas.py",
    "tests/learning/test_toy_translation.py",
    "tests/prove/test_legged.py",
    "tests/passport/test_levels.py",
    "tests/prove/test_legged_laws.py",
    "tests/export/test_onnx.py",
    "tests/diagnose/experiment/test_excite.py",
    "tests/architecture/test_startup.py",
    "tests/test_docs.py",
    "tests/locomotion/test_train.py",
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
