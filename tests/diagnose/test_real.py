"""Real machines, by pieces of their recordings: what their makers' own fits leave out."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import FromShared
from wt.data.recording import read
from wt.diagnose.recordings.prepare import unsplit
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.residual.screen import Screen
from wt.physics.scene import Scene
from wt.types import Recording


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
    best, *_ = screen.rank([])
    assert best.planted.effect.id == "joint.friction_directional"
    assert best.planted.theta[2:] == pytest.approx(np.array([157.0, 232.0]), rel=0.1)
