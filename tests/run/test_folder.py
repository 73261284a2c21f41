"""A run's folder belongs to one configuration, whoever does the work."""

from __future__ import annotations

from pathlib import Path

import pytest

from wt.config import load
from wt.errors import ConfigError
from wt.run.folder import claim, keep

DEBUG = Path(__file__).parents[2] / "conf" / "debug.yaml"


def test_a_run_goes_on_with_fewer_workers_as_its_message_advises(tmp_path: Path) -> None:
    keep(load(DEBUG, ["workers=2"]), tmp_path)
    resumed = claim(load(DEBUG, ["workers=1"]), tmp_path, load, resume=True)
    assert resumed.workers == 1


def test_a_run_goes_on_with_nothing_else_changed(tmp_path: Path) -> None:
    keep(load(DEBUG, ["workers=2"]), tmp_path)
    with pytest.raises(ConfigError, match="the configuration differs"):
        claim(load(DEBUG, ["workers=2", "seeds=[1]"]), tmp_path, load, resume=True)
