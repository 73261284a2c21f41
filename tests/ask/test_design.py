"""A designed experiment is safe on every machine that may be there, and tells them apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ask.conftest import AT, RATE, bias_or_dead_band, law, reach
from wt.ask.alive import Alive
from wt.ask.design import Design, Designer
from wt.ask.separation import Separation
from wt.diagnose.experiment.reach import Reach
from wt.physics.replay import Stretch
from wt.physics.scene import Scene

NOISE = np.array([1e-4])


def designed(
    arm: Scene, alive: list[Alive], may: Reach, seconds: float = 12.0, sharpen: bool = False
) -> Design | None:
    separation = Separation(arm, alive, NOISE, 1e-3)
    return Designer(arm, may, RATE, separation, alive).design(seconds, 0, sharpen)


def wide(arm: Scene) -> Reach:
    """Of a machine that has been everywhere."""
    return replace(reach(arm), low=np.array([-1.9]), high=np.array([1.9]))


def test_it_goes_where_they_differ(arm: Scene) -> None:
    found = designed(arm, bias_or_dead_band(), wide(arm))
    assert found is not None and found.expected.least > 10.0
    assert found.commands.seconds <= 12.0


@pytest.mark.long
def test_a_slow_machine_takes_its_time_to_where_they_differ(arm: Scene) -> None:
    """It never moved fast; the load turns over where it gets to in many seconds only."""
    slow = replace(wide(arm), speed=np.array([0.35]))
    found = designed(arm, bias_or_dead_band(), slow, seconds=24.0)
    assert found is not None and found.expected.least > 10.0
    assert found.commands.seconds <= 24.0
    moved = np.diff(found.commands.columns["qpos/j"][100:]) * RATE
    assert np.abs(moved).max() < 1.35 * 0.35


def test_nothing_is_asked_where_nothing_tells(arm: Scene) -> None:
    assert designed(arm, bias_or_dead_band(), reach(arm)) is None
    assert designed(arm, [law("actuator.bias", AT, 0.4, differs=False)], reach(arm)) is None


def test_nothing_is_asked_where_nothing_is_safe(arm: Scene) -> None:
    slow = replace(wide(arm), speed=np.array([1e-4]))
    assert designed(arm, bias_or_dead_band(), slow) is None


def test_every_machine_that_may_be_there_stays_inside(arm: Scene) -> None:
    weak = law("actuator.gain", AT, 0.5)
    alive = [law("actuator.bias", AT, 0.4, differs=False), weak]
    may = wide(arm)
    found = designed(arm, alive, may)
    assert found is not None
    u = found.commands.columns["ctrl/a"][:, None]
    whole = Stretch(0, found.commands.t, u, may.rest, np.zeros(1))
    (motions,) = Separation(arm, alive, NOISE, 1e-3).motions([whole])
    beside = np.abs(motions[:, 50, 0] - may.rest).max() + 0.05
    assert (np.abs(motions) < 1.9 + beside).all()
    speed = np.abs(np.diff(motions[:, 50:, 0], axis=1)) * RATE
    assert speed.max() < 1.35 * may.speed[0]


def test_parameters_alone_are_reason_enough_where_asked(arm: Scene) -> None:
    blunt = [law("actuator.gain", AT, 0.7, spread=0.3, differs=False)]
    assert designed(arm, blunt, reach(arm)) is None
    found = designed(arm, blunt, reach(arm), sharpen=True)
    assert found is not None and found.expected.information > 0.2
