"""What replays fit of a law, and what they leave as it was read off."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from tests.diagnose.hidden_forces import STEP, chain, record
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location


def test_what_has_no_step_stays(tmp_path: Path) -> None:
    def carry(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[0] = 0.4 * data.qvel[0]

    path, xml = tmp_path / "robot.xml", chain(1)
    path.write_text(xml)
    scene = Scene(path)
    smoothed = smooth(scene, [Part(record(xml, carry, 6.0, 0), 0)])
    objective = Objective(smoothed, stretches_of(smoothed, True), STEP, True)
    objective.reference(())
    forward = effects()["actuator.feedforward"]
    assert forward.parameters[1].step == 0.0  # the period of commands
    start = Planted(forward, Location("actuator", scene.drives[0].name), np.array([0.05, 0.02]))
    (found,) = refine(objective, [(start,)], [[0]], iterations=4)
    coefficient, period = found.hypothesis[0].theta
    assert period == 0.02
    assert coefficient > 0.1
