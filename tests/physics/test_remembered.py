"""What was replayed lately is told again, to the bit, and nothing else is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.physics.test_limbs import hand, planted, recorded, scene
from wt.physics import remembered
from wt.physics.planted import Planted
from wt.physics.remembered import Remembered
from wt.physics.rollout import Replayer

GAIN = planted("actuator.gain", "actuator", "b2_drive", 0.8)
FRICTION = planted("joint.friction_viscous", "joint", "a1", 0.1)


def once(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Degrees of freedom of what is stepped, one entry for each hypothesis."""
    stepped: list[int] = []
    part = Replayer.part

    def counted(self: Replayer, hypotheses: Sequence[object], *more: object) -> np.ndarray:
        stepped.extend([self.scene.model.nv] * len(hypotheses))
        return part(self, hypotheses, *more)  # type: ignore[arg-type]

    monkeypatch.setattr(Replayer, "part", counted)
    return stepped


def test_a_replay_is_run_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = scene(tmp_path, hand(between=""))
    stretch, stepped = recorded(machine), once(monkeypatch)
    replayer = Replayer(machine, [stretch], 1e-3)
    first = replayer.run([(GAIN,), (), (GAIN,)])
    assert stepped == [2, 2, 2]  # one finger as it is, the other with and without the gain
    again = replayer.run([(), (GAIN,)])
    assert len(stepped) == 3
    np.testing.assert_array_equal(again.q, first.q[[1, 0]])
    np.testing.assert_array_equal(again.v, first.v[[1, 0]])
    fresh = Replayer(machine, [stretch], 1e-3).run([(), (GAIN,)])
    np.testing.assert_array_equal(again.q, fresh.q)


def test_a_limb_that_stays_as_it_was_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = scene(tmp_path, hand())
    stretch, stepped = recorded(machine), once(monkeypatch)
    replayer = Replayer(machine, [stretch], 1e-3)
    replayer.run([()])
    stepped.clear()
    replayer.run([(FRICTION,)])
    replayer.run([(GAIN, FRICTION)])
    assert stepped == [2, 2]


def test_what_is_told_again_cannot_be_changed_by_who_was_told() -> None:
    known = Remembered()
    first = known.paths([(GAIN,)], lambda new: np.zeros((2, len(new), 3, 1)))
    first[:] = 1.0
    assert not known.paths([(GAIN,)], lambda new: np.ones((2, len(new), 3, 1))).any()


def test_other_figures_and_places_are_other_replays() -> None:
    known, run = Remembered(), list[int]()

    def replay(new: Sequence[Sequence[Planted]]) -> np.ndarray:
        run.append(len(new))
        return np.zeros((2, len(new), 3, 1))

    stronger = planted("actuator.gain", "actuator", "b2_drive", 0.9)
    elsewhere = planted("actuator.gain", "actuator", "b1_drive", 0.8)
    known.paths([(GAIN,), (stronger,), (elsewhere,), (GAIN,)], replay)
    known.paths([(GAIN,)], replay)
    assert run == [3]


def test_the_oldest_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remembered, "_BYTES", 2 * np.zeros((2, 3, 1)).nbytes)
    known, run = Remembered(), list[int]()

    def replay(new: Sequence[Sequence[Planted]]) -> np.ndarray:
        run.append(len(new))
        return np.zeros((2, len(new), 3, 1))

    for hypothesis in ((GAIN,), (FRICTION,), (GAIN,), (), (FRICTION,)):
        known.paths([hypothesis], replay)
    assert len(run) == 4
