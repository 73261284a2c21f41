"""Laws that act at every step: each replay is as it would be alone, and as Python says."""

from __future__ import annotations

import inspect
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.physics.arm import ARM, JOINTS
from tests.physics.machine_code import called
from wt.physics import compiled
from wt.physics.effect import effects
from wt.physics.effects import _bristle
from wt.physics.effects.friction_position import FrictionPosition
from wt.physics.hooks import OnSteps
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


def test_two_leaks_into_a_joint_add_up(scene: Scene) -> None:
    both, one, other, none = (
        replayed(scene, [tuple(h)])[0, :, 2] for h in (LEAKS, LEAKS[:1], LEAKS[1:], [])
    )
    early = slice(8)
    apart = one[early] + other[early] - 2.0 * none[early]
    np.testing.assert_allclose(both[early] - none[early], apart, rtol=0.05)
    assert np.abs(both - none).max() > 1e-2


LAWS = [
    *DRY[:1],
    *DEAD[:1],
    *LOADED[:1],
    *LEAKS[:1],
    law("joint.friction_directional", "j1", 0.2, 0.3, 0.1, 0.05),
    law("joint.friction_position", "j1", 0.2, 0.5, 0.3, 0.1),
    law("joint.gear_loss", "j1", 0.1, 0.3, 0.2, 0.1),
    law("actuator.speed_limit", "m1", 2.0, 1.5),
    law("actuator.fade", "m1", 0.4, 3.0),
]


@pytest.mark.parametrize("planted", LAWS, ids=lambda p: p.effect.id)
def test_machine_code_says_what_python_says(scene: Scene, planted: Planted) -> None:
    assert isinstance(planted.effect, OnSteps)
    h = 1e-3
    by_python, by_machine = (
        planted.effect.live(scene, [planted.at], planted.theta[None], h) for _ in range(2)
    )
    rng, dof = np.random.default_rng(0), int(by_python.dofs[0])
    said = []
    for step in range(50):
        q, v, u = rng.normal(size=(3, JOINTS))
        now = (0.3 + step * h, h)
        own = by_python.own[0], by_machine.own[0]
        state = np.tile(q, 2), np.tile(v, 2), u  # drives are on no rotors
        want = by_python.law.acts(dof, *state, *now, by_python.theta[0], own[0])
        got = called(by_machine, q, v, u, *now)
        np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(*own, rtol=1e-12, atol=1e-15)
        said.append(got)
    assert np.ptp(said) > 0.01


def test_a_law_is_another_where_what_it_calls_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acts = FrictionPosition.law.acts

    def name() -> str:
        return compiled._of_this_version(acts).__qualname__

    before, helpers = name(), Path(inspect.getfile(inspect.unwrap(_bristle.brake)))
    assert name() == before
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"#" * (path == helpers))
    assert name() != before


def test_what_cannot_be_kept_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def added(a: float, b: float) -> float:
        return a + b

    assert compiled.fast(added)._cache._impl is not None
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])
    assert compiled.fast(added)(1.0, 2.0) == 3.0
