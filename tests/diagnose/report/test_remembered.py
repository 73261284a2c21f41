"""What the firmware of servos remembers when a window begins is in the files that are written."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import NOISE, STEP, World, chain, world
from wt.diagnose.report.handed_over import HandedOver, hand_over
from wt.diagnose.report.verify import replayed_files
from wt.diagnose.selection.holdout import errors
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

AS_GOOD = 4e-4
"""What is left [rad] if nothing is missing: that machine holds its commands half a step earlier."""
KP, KI, SLEW, SPEED, ACCELERATION = (80.0, 70.0, 60.0), 30.0, 0.6, 0.9, 5.0


class Firmware:
    """A drive with a profile, one with integral action and one whose goal is slow, by hand."""

    model: mujoco.MjModel

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Add what a position servo does not do; a machine that is new begins at its command."""
        u = data.ctrl.copy()
        if getattr(self, "model", None) is not model:
            self.model, self.goal, self.rate, self.sum = model, u.copy(), 0.0, 0.0
        left = u[0] - self.goal[0]
        wanted = np.sign(left) * min(SPEED, np.sqrt(2.0 * ACCELERATION * abs(left)))
        self.rate += np.clip(wanted - self.rate, -ACCELERATION * STEP, ACCELERATION * STEP)
        self.goal[0] += self.rate * STEP
        self.goal[2] += np.clip(u[2] - self.goal[2], -SLEW * STEP, SLEW * STEP)
        data.qfrc_applied[:] += np.array(KP) * (self.goal - u) * [1.0, 0.0, 1.0]
        data.qfrc_applied[1] += KI * self.sum
        self.sum += (u[1] - data.qpos[1]) * STEP


FOUND = tuple(
    Planted(effects()[f"actuator.{name}"], Location("actuator", at), np.array(theta))
    for name, at, theta in (
        ("profile", "a1", [SPEED, ACCELERATION]), ("integral", "a2", [KI]),
        ("slew_rate", "a3", [SLEW]),
    )
)  # fmt: skip


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world(tmp_path_factory.mktemp("machine"), 3, Firmware(), seconds=8.0)


@pytest.fixture(scope="module")
def files(machine: World) -> HandedOver:
    said = [p.statement(machine.held.smoothed.motion.scene) for p in FOUND]
    return hand_over(machine.held, FOUND, (FOUND, said), ("a.parquet", "b.parquet"), None)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def test_windows_begin_with_what_was_before(machine: World, files: HandedOver) -> None:
    replays = replayed_files(files.contents, chain(3))
    assert 30.0 * rms(replays.physics) < rms(replays.before)
    assert rms(replays.physics) < AS_GOOD
    own = errors(machine.held, [(), FOUND], 5e-4)
    np.testing.assert_allclose(replays.before, own[0], atol=0.05 * NOISE)
    np.testing.assert_allclose(replays.physics, own[1], atol=0.3 * NOISE)


def test_the_model_alone_has_what_is_native(machine: World, files: HandedOver) -> None:
    replays = replayed_files(files.contents, chain(3))
    assert rms(replays.model[:, 2]) < 0.1 * rms(replays.before[:, 2])
    assert 'ki="30"' in files.model_xml or 'gainprm="30"' in files.model_xml


def test_a_stretch_may_begin_anywhere(machine: World) -> None:
    """Each of the three is as good from the middle as from the begin."""
    for stretch in machine.held.stretches:
        known = {name: x for p in FOUND for name, x in p.remembered(stretch).items()}
        assert set(known) == {"a1 profile", "a1 profile's rate", "a2 integral", "a3 goal"}
        assert np.isfinite(list(known.values())).all()
