"""Coarse encoders are read off the recorded values; fine ones are no finding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.diagnose.recordings.grid import coarse_steps, located
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.scene import Scene
from wt.physics.units import HINGE
from wt.types import Recording


def swing(step: float, seed: int, offset: float = 0.0, rate: float = 2.0) -> Part:
    """A swinging joint whose encoder has steps; no steps if ``step`` is 0."""
    t = np.arange(0.0, 6.0, 0.01)
    q = 0.6 * np.sin(rate * t + seed) + 2e-4 * np.random.default_rng(seed).standard_normal(len(t))
    if step:
        q = step * np.round((q - offset) / step) + offset
    q[7] = np.nan
    columns = {"ctrl/a": q, "qpos/j": q}
    return Part(Recording(t, columns, {}), 0)


@pytest.mark.parametrize(("step", "offset"), [(0.004, 0.0), (0.012, 0.0), (0.04, 0.013)])
def test_steps_are_read_off(step: float, offset: float) -> None:
    (found,) = coarse_steps([swing(step, 0, offset)], [swing(step, 1, offset)], {"j": HINGE})
    estimate = found.parameters["step"]
    assert found.effect == "sensor.quantization" and found.at.name == "j"
    assert estimate.value == pytest.approx(step, rel=1e-3)
    assert estimate.ci95[0] <= step <= estimate.ci95[1]
    assert found.p_value < 1e-6
    (place,) = located([found], alone=True)
    assert place.at == found.at and place.share == 1.0


@pytest.mark.parametrize("step", [0.0, 2.0 * np.pi / 4096, 0.99 * THRESHOLDS.encoder_step])
def test_what_any_encoder_has_is_no_finding(step: float) -> None:
    assert coarse_steps([swing(step, 0)], [swing(step, 1)], {"j": HINGE}) == ()


def test_a_grid_that_held_out_data_do_not_have_is_none() -> None:
    assert coarse_steps([swing(0.01, 0)], [swing(0.0, 1)], {"j": HINGE}) == ()
    assert coarse_steps([swing(0.01, 0)], [swing(0.013, 1)], {"j": HINGE}) == ()


def test_what_steps_round_by_is_noise(tmp_path: Path) -> None:
    """Of a joint that is slow: it stays on a step for several samples, which differ by nothing."""
    path = tmp_path / "robot.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<actuator><position name="a" joint="j" kp="10"/></actuator></mujoco>'
    )
    smoothed = smooth(Scene(path), [swing(0.03, 0, rate=0.5)])
    assert smoothed.noise == pytest.approx([0.03 / np.sqrt(12.0)], rel=1e-3)
