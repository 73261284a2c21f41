"""A designed experiment is safe on every machine that may be there, and tells them apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ask.conftest import AT, RATE, bias_or_dead_band, law, limits, reach
from wt.ask.alive import Alive
from wt.ask.design import Design, Designer
from wt.ask.limits import Limits, forces, limits_of
from wt.ask.separation import Separation
from wt.diagnose.experiment.reach import Reach, Shown
from wt.physics.replay import Stretch
from wt.physics.scene import Scene
from wt.types import Location

NOISE = np.array([1e-4])


def designed(
    arm: Scene,
    alive: list[Alive],
    may: Reach,
    seconds: float = 12.0,
    sharpen: bool = False,
    within: Limits | None = None,
) -> Design | None:
    separation = Separation(arm, alive, NOISE, 1e-3)
    designer = Designer(arm, may, RATE, separation, alive, within or limits(arm))
    return designer.design(seconds, 0, sharpen)


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


def asked_of(arm: Scene, alive: list[Alive], found: Design) -> np.ndarray:
    """Torques that the drive gives in an experiment on each machine (hypothesis, sample) [N·m]."""
    u = found.commands.columns["ctrl/a"][:, None]
    whole = Stretch(0, found.commands.t, u, wide(arm).rest, np.zeros(1))
    (motions,) = Separation(arm, alive, NOISE, 1e-3).motions([whole])
    each = [forces(arm, u, q, np.gradient(q, 1.0 / RATE, axis=0)) for q in motions]
    return np.array(each)[:, 150:, 0]


def test_no_machine_that_may_be_there_needs_more_torque_than_allowed(arm: Scene) -> None:
    """The one that carries two kilograms does: the model as given says nothing of it."""
    loaded = law("body.payload_fixed", Location("body", "link"), 2.0, 0.15, 0.0, 0.0)
    alive = [law("actuator.bias", AT, 0.4, differs=False), loaded]
    free = designed(arm, alive, wide(arm))
    assert free is not None
    most = float(np.abs(asked_of(arm, alive, free)).max())
    tight = replace(limits(arm), force=0.9 * most * np.array([[-1.0], [1.0]]))
    found = designed(arm, alive, wide(arm), within=tight)
    assert found is not None and np.abs(asked_of(arm, alive, found)).max() < 0.92 * most


def test_no_drive_is_heated_more_than_allowed(arm: Scene) -> None:
    """It carries 1.2 N·m wherever it stands: what may last less asks nothing of it."""
    alive = bias_or_dead_band()
    free, cool, warm = (
        designed(arm, alive, wide(arm), within=replace(limits(arm), lasting=np.array([most])))
        for most in (np.inf, 0.7, 2.0)
    )
    assert cool is None
    assert free is not None and warm is not None
    assert np.sqrt((asked_of(arm, alive, warm) ** 2).mean(axis=1)).max() < 2.0
    assert free.motions == warm.motions


def test_it_stays_in_the_room_that_it_was_in(arm: Scene) -> None:
    """Level within half a radian: the tip was 0.16 m up and down, and may go a tenth further."""
    shown = Shown("all", False, *(np.linspace(-0.5, 0.5, 100)[:, None],) * 3)
    acted = [np.linspace(-0.5, 0.5, 100)[:, None]]
    within = limits_of(arm, [shown], acted, whole_range=False)
    assert within.room is not None
    assert within.room[1, 2] == pytest.approx(0.17 + 0.2 * 0.17, abs=0.03)
    assert limits_of(arm, [shown], acted, whole_range=True).room is None
    q = np.linspace(-0.4, 0.4, 50)[:, None]
    assert not within.broken(np.zeros((50, 1)), q)
    assert within.broken(np.zeros((50, 1)), 3.0 * q)


def test_a_model_that_limits_no_force_is_limited_by_what_was_shown(arm: Scene) -> None:
    """A servo of 40 N·m/rad and 2 N·m·s/rad that was up to 0.1 rad behind, at rest."""
    still = np.zeros((100, 1))
    shown, acted = Shown("all", False, still, still, still), [np.linspace(0.0, 0.1, 100)[:, None]]
    within = limits_of(arm, [shown], acted, whole_range=True)
    np.testing.assert_allclose(within.force[:, 0], [-5.2, 5.2], rtol=0.02)
    np.testing.assert_allclose(within.lasting, 1.3 * 4.0 / np.sqrt(3.0), rtol=0.02)
    nothing = limits_of(arm, [], [], whole_range=False)
    assert not nothing.broken(np.full((9, 1), 1e9), np.zeros((9, 1)))


def test_parameters_alone_are_reason_enough_where_asked(arm: Scene) -> None:
    blunt = [law("actuator.gain", AT, 0.7, spread=0.3, differs=False)]
    assert designed(arm, blunt, reach(arm)) is None
    found = designed(arm, blunt, reach(arm), sharpen=True)
    assert found is not None and found.expected.information > 0.2
