"""Real machines, by pieces of their recordings: what their makers' own fits leave out."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import FromShared
from wt.data.recording import read
from wt.diagnose.recordings.prepare import unsplit
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.residual.screen import Screen
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.scene import Scene
from wt.types import Location, Recording


def piece(from_shared: FromShared, model: str, recording: str, seconds: float) -> Smoothed:
    """The beginning of a recording, smoothed."""
    scene = Scene(from_shared(f"cases/real/{model}.xml"))
    whole = read(from_shared(f"cases/real/{recording}.parquet"))
    some = whole.t < whole.t[0] + seconds
    columns = {name: column[some] for name, column in whole.columns.items()}
    return smooth(scene, unsplit(scene, [Recording(whole.t[some], columns, {})]))


def test_a_ball_screw_is_braked_less_one_way_than_its_makers_say(from_shared: FromShared) -> None:
    """Fitted by hand to all of it: 157 N·s/m one way and 232 the other, where the model has 203."""
    screen = Screen(piece(from_shared, "emps_pub", "emps_fit", 16.0))
    assert screen.motion.dt == pytest.approx(0.003)
    at, motor = Location("joint", "slide"), Location("actuator", "motor")
    laws = {("joint.friction_directional", at), ("joint.stiffness", at), ("actuator.bias", motor)}
    best, *_ = screen.rank([], laws)
    assert best.planted.effect.id == "joint.friction_directional"
    assert best.planted.theta[2:] == pytest.approx(np.array([157.0, 232.0]), rel=0.1)


def test_a_calf_behind_a_linkage_sticks_more_the_further_it_is_folded(
    from_shared: FromShared,
) -> None:
    """Drawn over the calf's position, what plain dry friction leaves is a half-wave: see-saw."""
    screen = Screen(piece(from_shared, "go2_RL", "go2_RL_fit", 10.0))
    at = Location("joint", "RL_calf_joint")
    laws = ("coulomb", "directional", "load", "position", "stribeck")
    best, second, *_ = screen.rank([], {(f"joint.friction_{law}", at) for law in laws})
    assert best.planted.effect.id == "joint.friction_position"
    assert best.gain > second.gain + THRESHOLDS.min_nats
    coulomb, depth, wave, phase = best.planted.theta
    folded, stretched = (
        coulomb * (1.0 + depth * np.sin(2.0 * np.pi * q / wave + phase)) for q in (-2.3, -1.4)
    )
    assert folded > 1.5 * stretched
