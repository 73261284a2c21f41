"""A learned law acts in replays as it was learned: compiled, in Python, and as arrays."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from tests.physics.arm import ARM, scene
from tests.physics.machine_code import called
from wt.diagnose.unknown.law import Atom, AtomKind, Law, table
from wt.diagnose.unknown.live import live
from wt.physics.scene import Scene
from wt.types import Location

COLUMNS = ("t", "qpos/j1", "qvel/j2", "ctrl/m0", "force/m1")
ATOMS = [
    Atom(i % len(COLUMNS), kind, 0.2, -1.0 if kind == "side" else 0.7)
    for i, kind in enumerate(get_args(AtomKind))
]
TERMS = ((), *((a,) for a in ATOMS), (ATOMS[0], ATOMS[5]), (ATOMS[8], ATOMS[2]))


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    return scene(tmp_path, ARM)


def law(terms: tuple[tuple[Atom, ...], ...]) -> Law:
    weights = np.linspace(0.5, 2.0, len(terms))
    size = np.array([1.0, 1.0, 1.0, 1.0, 50.0])
    return Law(COLUMNS, -0.4 * size, 0.6 * size, terms, weights)


@pytest.mark.parametrize("terms", [TERMS, *((t,) for t in TERMS), ()], ids=len)
def test_it_acts_as_it_was_learned(terms: tuple[tuple[Atom, ...], ...], arm: Scene) -> None:
    rng, n, amplitude, h = np.random.default_rng(0), 200, 0.7, 1e-3
    learned = law(terms)
    t = rng.uniform(-0.6, 0.8, n)
    q, v, u = rng.normal(0.0, 0.5, (3, n, 3))
    want = amplitude * learned.force(table(arm, COLUMNS, t, q, v, u))
    acting = live(learned, arm, [Location("joint", "j1")], np.array([[amplitude]]), h)
    got = [called(acting, q[k], v[k], u[k], float(t[k]), h) for k in range(n)]
    np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-12)
    assert not terms or np.count_nonzero(want) > 50
