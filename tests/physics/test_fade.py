"""A drive that heats up under load, against a machine that does so by code of this test."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import World, world
from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.residual.signature import signature
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

LOSS, TAU, RATED = 0.4, 3.0, 1.0
AT = Location("actuator", "a1")


class Warming:
    """Weakens the drive of j1 by its heat; cold until the recording begins."""

    def __init__(self) -> None:
        self.heat = 0.0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        force = 80.0 * (data.ctrl[0] - data.qpos[0]) - 4.0 * data.qvel[0]
        if data.time <= 0.0:
            self.heat = 0.0
        data.qfrc_applied[0] -= LOSS * min(self.heat, 1.5) * force
        self.heat += model.opt.timestep / TAU * ((force / RATED) ** 2 - self.heat)


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world(Path(tmp_path_factory.mktemp("warm")), 1, Warming())


def planted(usual: float) -> Planted:
    effect = effects()["actuator.fade"].shaped((TAU, usual))
    return Planted(effect, AT, np.array([LOSS, TAU]))


def test_signature_is_the_force_that_is_lost(warm: World) -> None:
    found = signature(warm.screen.motion, planted(RATED))
    assert found is not None
    lost = LOSS * found[:, 0, 0]
    residual = warm.screen.motion.residual[:, 0]
    assert np.corrcoef(lost, residual)[0, 1] > 0.97
    # taken as a matter of time alone, it is another force
    other = signature(warm.screen.motion, planted(0.0))
    assert other is not None
    assert np.mean((residual - lost) ** 2) < 0.5 * np.mean((residual - LOSS * other[:, 0, 0]) ** 2)


def test_replays_warm_up_as_the_machine_does(warm: World) -> None:
    cold, timed, right = warm.objective.evaluate([(), (planted(0.0),), (planted(RATED),)])
    size = [float(np.sqrt((a.error**2).mean())) for a in (cold, timed, right)]
    assert size[2] < 0.1 * size[0]
    assert size[2] < 0.3 * size[1]


def test_the_usual_load_is_read_off_and_stays(warm: World) -> None:
    effect, motion = effects()["actuator.fade"], warm.screen.motion
    force = motion.force(motion.scene.drive("a1"))
    usual = float(np.sqrt(np.mean(force**2)))
    shapes = effect.shapes(motion, AT)
    assert [shape[1:] for shape in shapes[:5]] == 5 * [(usual,)]
    assert all(load < usual and read == usual for _, load, read in shapes[5:])
    bound = effect.shaped((3.0, 7.0))
    assert {shape[1] for shape in bound.shapes(motion, AT)} == {7.0}
    assert "7 N·m" in bound.statement(AT, np.array([0.2, 3.0]))


def test_a_smaller_load_is_tried_where_it_makes_all_the_heat_there_can_be(warm: World) -> None:
    effect, motion = effects()["actuator.fade"], warm.screen.motion
    shapes = effect.shapes(motion, AT)
    usual = shapes[0][1]
    tried = {(time, round(load / usual, 2)) for time, load, _ in shapes[5:]}
    assert (shapes[0][0], 0.85) in tried  # a tenth of the recording: hot soon
    assert (shapes[4][0], 0.85) not in tried  # twice the recording: never as hot


@pytest.mark.long
def test_where_it_is_hot_the_load_is_fitted_and_not_reported(warm: World) -> None:
    effect, motion = effects()["actuator.fade"], warm.screen.motion
    usual = float(np.sqrt(np.mean(motion.force(motion.scene.drive("a1")) ** 2)))
    shape = (TAU, 0.9 * RATED, usual)
    hot = effect.shaped(shape)
    start = Planted(hot, AT, hot.theta(np.array([LOSS]), shape))
    found = estimate(warm.objective, (start,))
    (now,) = found.hypothesis
    np.testing.assert_allclose(now.theta, [LOSS, TAU, RATED], rtol=0.08)
    assert list(found.estimates[0]) == ["loss", "time_constant"]
    # how a drive warms up is known to a few per cent at best, however well one law fits
    known = found.estimates[0]["time_constant"]
    low, high = known.ci95
    assert low <= 0.97 * known.value and high >= 1.03 * known.value  # type: ignore[operator]
    assert f"{now.theta[2]:.3g} N·m" in now.statement(warm.objective.scene)
