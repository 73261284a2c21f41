"""Expected separations are those of Gaussian replays with what neither hypothesis is sure of."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ask.conftest import AT, JOINT, RATE, bias_or_dead_band, law
from wt.ask.alive import Alive
from wt.ask.separation import Beyond, Expected, Separation
from wt.physics.replay import Stretch
from wt.physics.scene import Scene

NOISE = np.array([1e-4])


def stretch(q: np.ndarray) -> Stretch:
    """Commands from a pose at rest."""
    t = np.arange(len(q)) / RATE
    return Stretch(0, t, q[:, None], q[:1], np.zeros(1))


def expected(arm: Scene, alive: list[Alive], q: np.ndarray) -> Expected:
    (found,) = Separation(arm, alive, NOISE, 1e-3).expected([stretch(q)], [100])
    return found


def level(seconds: float = 4.0) -> np.ndarray:
    """Stands level, where gravity pulls one way."""
    return 0.1 * np.sin(np.arange(0.0, seconds, 1.0 / RATE))


def left(r: np.ndarray, nuisance: np.ndarray) -> float:
    return float(Beyond(nuisance).product(r[None], r[None])[0, 0])


def test_woodbury() -> None:
    rng = np.random.default_rng(0)
    r, a = rng.normal(size=30), 3.0 * rng.normal(size=(4, 30))
    assert left(r, a) == pytest.approx(r @ np.linalg.inv(np.eye(30) + a.T @ a) @ r)
    assert left(2.0 * a[1], a) < 4.0  # a deviation of two explains it


def test_the_same_machine_is_not_told_apart(arm: Scene) -> None:
    twice = [law("actuator.bias", AT, 0.4), law("actuator.bias", AT, 0.4)]
    assert expected(arm, twice, level()).most < 1e-9


def test_what_other_parameters_explain_tells_nothing(arm: Scene) -> None:
    near = [law("actuator.bias", AT, 0.4), law("actuator.bias", AT, 0.42)]
    far = [law("actuator.bias", AT, 0.4), law("actuator.bias", AT, 0.9)]
    assert expected(arm, near, level()).most < 1.0
    assert expected(arm, far, level()).most > 10.0


def test_a_load_of_one_sign_tells_nothing_and_of_both_does(arm: Scene) -> None:
    alive = bias_or_dead_band()
    assert expected(arm, alive, level()).least < 1.0
    other_side = np.concatenate([np.zeros(150), np.full(400, -1.9)])
    assert expected(arm, alive, other_side).least > 10.0


def test_parameters_become_known(arm: Scene) -> None:
    blunt = [law("joint.friction_coulomb", JOINT, 0.2, spread=0.5)]
    sharp = [law("joint.friction_coulomb", JOINT, 0.2, spread=0.005)]
    q = 0.4 * np.sin(np.arange(0.0, 5.0, 1.0 / RATE))
    assert expected(arm, blunt, q).information > expected(arm, sharp, q).information > 0.0
    assert expected(arm, blunt, q).least == expected(arm, blunt, q).most == 0.0


def test_a_joint_that_is_not_measured_tells_nothing(arm: Scene) -> None:
    (found,) = Separation(arm, bias_or_dead_band(), np.array([np.nan]), 1e-3).expected(
        [stretch(np.full(400, -1.9))], [100]
    )
    assert found.most == 0.0
