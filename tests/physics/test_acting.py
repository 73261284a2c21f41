"""A law acts everywhere in one call, and each replay is as it would be alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import ARM, JOINTS
from wt.physics.acting import acting
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return Scene(path)


def law(name: str, place: str, *theta: float) -> Planted:
    effect = effects()[name]
    return Planted(effect, Location(effect.kind, place), np.array(theta))


DRY = [law("joint.friction_stribeck", f"j{i}", 0.2 + 0.1 * i, 0.5, 0.1) for i in range(JOINTS)]
DEAD = [law("actuator.deadband", f"m{i}", 0.3 + 0.2 * i) for i in range(JOINTS)]
LOADED = [law("joint.friction_load", f"j{i}", 0.1, 0.05 + 0.02 * i) for i in range(JOINTS)]
LEAKS = [law("pair.crosstalk", "j0+j2", 0.3), law("pair.crosstalk", "j1+j2", 0.2)]
HYPOTHESES = [
    (),
    (DRY[0],),
    (DRY[2], DEAD[1], DRY[1]),
    tuple(LEAKS),
    (LEAKS[1], LOADED[0], LOADED[2], DEAD[0]),
    (*LOADED, *DEAD, *DRY, *LEAKS),
]


def replayed(scene: Scene, hypotheses: list[tuple[Planted, ...]]) -> np.ndarray:
    t = np.arange(150) * 0.01
    command = 0.4 * np.sin(t[:, None] * [5.0, 7.0, 9.0])
    stretches = [
        Stretch(0, t[:n], command[:n], np.full(JOINTS, start), np.zeros(JOINTS))
        for n, start in ((150, 0.0), (120, 0.1), (60, -0.1))
    ]
    return Replayer(scene, stretches, 1e-3).run(hypotheses).q


def test_each_replay_is_to_the_bit_as_alone(scene: Scene) -> None:
    together = replayed(scene, HYPOTHESES)
    alone = [replayed(scene, [h])[0] for h in HYPOTHESES]
    assert np.isfinite(together).all()
    np.testing.assert_array_equal(together, alone)


def test_the_order_of_laws_is_none_of_the_physics(scene: Scene) -> None:
    one, other = replayed(scene, [HYPOTHESES[-1], HYPOTHESES[-1][::-1]])
    np.testing.assert_array_equal(one, other)


def test_one_call_for_all_places_of_a_law(scene: Scene) -> None:
    acts = acting(scene, HYPOTHESES)
    assert len(acts) == 4
    assert sum(len(a.cells) for a in acts) == sum(map(len, HYPOTHESES))


def test_two_leaks_into_a_joint_add_up(scene: Scene) -> None:
    (act,) = acting(scene, [LEAKS])
    assert act.twice
    total = np.zeros((1, JOINTS))
    act.add(np.array([2.0, 3.0]), total.reshape(-1))
    np.testing.assert_array_equal(total, [[0.0, 0.0, 5.0]])
    both, first = (replayed(scene, [tuple(h)])[0] for h in (LEAKS, LEAKS[:1]))
    assert np.abs(both - first)[:, 2].max() > 1e-3
