"""What joints cannot show is not fitted: a force across a rail, or along a hinge's axis."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, chain, record
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.likelihood.shown import hidden_axes, shown, without_hidden
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

LINK = Location("body", "link1")
FORCE = Planted(effects()["body.force"], LINK, np.array([0.5, 3.0, 0.0]))
TETHER = Planted(effects()["body.tether"], LINK, np.array([20.0, 0.5, 3.0, 0.0]))


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_plane_shows_what_lies_in_it(tilt: float) -> None:
    axis = np.array([0.0, np.cos(tilt), np.sin(tilt)])
    seen = np.random.default_rng(0).normal(size=(400, 1, 3))
    slope = seen - (seen @ axis)[..., None] * axis
    projector = shown([FORCE], slope, np.ones((400, 1)))
    np.testing.assert_allclose(projector, np.eye(3) - np.outer(axis, axis), atol=1e-9)
    assert hidden_axes(projector) == ([1] if tilt == 0.0 else [])


def test_scalars_and_vectors_that_show_nothing_are_left_alone() -> None:
    slope = np.zeros((50, 1, 4))
    slope[:, :, 0] = 1.0
    np.testing.assert_array_equal(shown([TETHER], slope, np.ones((50, 1))), np.eye(4))


def test_what_is_not_shown_is_nothing_where_that_has_a_value() -> None:
    flat = np.diag([1.0, 0.0, 1.0])
    np.testing.assert_array_equal(without_hidden([FORCE], FORCE.theta, flat), [0.5, 0.0, 0.0])
    both = np.diag([1.0, 1.0, 0.0, 1.0])
    np.testing.assert_array_equal(without_hidden([TETHER], TETHER.theta, both), TETHER.theta)


def test_a_force_along_the_only_axis_is_not_fitted(tmp_path: Path) -> None:
    xml = chain(1)

    def push(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.xfrc_applied[1, 0] = 4.0

    path = tmp_path / "robot.xml"
    path.write_text(xml)
    smoothed = smooth(Scene(path), [Part(record(xml, push, 6.0, 0), 0)])
    objective = Objective(smoothed, stretches_of(smoothed, True), STEP, True)
    objective.reference(())
    (found,) = refine(objective, [(FORCE,)], [[0]], iterations=6)
    force = found.hypothesis[0].theta
    assert force[1] == 0.0  # began at 3 N along the hinge
    assert np.sqrt(found.mse[0]) < 3.0 * objective.floor[0]
