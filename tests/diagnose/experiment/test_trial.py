"""A motion is tried on the model before it is suggested."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.diagnose import synthetic
from wt.diagnose.experiment.trial import trial
from wt.physics.scene import Scene


def test_drives_that_integrate_begin_where_the_motion_does(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(synthetic.ARM.replace("<position ", "<intvelocity "))
    t = 0.01 * np.arange(300)
    wanted = np.stack([0.6 + 0.3 * np.sin(t), -0.4 + 0.2 * np.sin(2.0 * t)], axis=1)
    tried = trial(Scene(path), wanted, 100.0)
    assert np.abs(tried.q - wanted).max() < 0.1
    assert np.abs(tried.ctrl).max() < 1.0  # rad/s
