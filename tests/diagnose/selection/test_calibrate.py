"""Small corrections beside findings: only what a model can hold, and said to be no finding."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.physics.arm import scene
from wt.diagnose.likelihood.tolerances import tolerances
from wt.diagnose.selection.calibration import comments
from wt.diagnose.thresholds import THRESHOLDS


def test_a_model_is_corrected_by_what_it_can_hold(tmp_path: Path) -> None:
    some = tolerances(scene(tmp_path))
    kinds = {n.planted.effect.id for n in some if n.effect.correctable}
    assert kinds == {"body.mass", "joint.armature", "actuator.gain"}  # this arm has no damping
    assert any(not n.effect.correctable for n in some)  # timing


def test_no_correction_makes_a_rotor_lighter_than_nothing(tmp_path: Path) -> None:
    machine = scene(tmp_path)
    for n in tolerances(machine):
        if n.planted.effect.id == "joint.armature":
            own = machine.model.dof_armature[machine.dof(n.planted.at.name)]
            assert own + n.scaled(-THRESHOLDS.tolerance_box).theta[0] >= 0.0


def test_a_correction_is_said_to_be_no_finding(tmp_path: Path) -> None:
    mass = next(n for n in tolerances(scene(tmp_path)) if n.planted.effect.id == "body.mass")
    (said,) = comments((mass.scaled(1.0),))
    assert said.startswith("Within tolerance, no finding: body.mass of body ")
    assert said.endswith(f"factor {float(mass.planted.theta[0]):.4g}")
    assert np.isfinite(mass.planted.theta).all()
