"""The library of a formula's terms has what machines do, so that the simplest right one wins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, chain, record
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.residual.screen import Screen
from wt.diagnose.unknown.fit import ForceData, solve
from wt.diagnose.unknown.formula import sparse
from wt.physics.scene import Scene

Array = np.ndarray


@pytest.fixture(scope="module")
def screen(tmp_path_factory: pytest.TempPathFactory) -> Screen:
    path = tmp_path_factory.mktemp("chain") / "robot.xml"
    path.write_text(chain(2))
    return Screen(smooth(Scene(path), [Part(record(chain(2), None, 8.0, 0), 0)]))


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (lambda q, v: -5.0 * np.maximum(v[:, 0], 0.0), "-5·max(qvel/j1, 0)"),
        (lambda q, v: 3.0 * np.maximum(-v[:, 0], 0.0), "3·max(-qvel/j1, 0)"),
        (lambda q, v: -2.0 * np.abs(v[:, 0]), "-2·|qvel/j1|"),
        (lambda q, v: -2.0 * np.abs(v[:, 0]) * v[:, 0], "-2·|qvel/j1|·qvel/j1"),
        (lambda q, v: -0.7 * q[:, 1] * v[:, 0], "-0.7·qvel/j1·qpos/j2"),
        (lambda q, v: -4.0 * v[:, 0] - 3.0 * np.maximum(v[:, 0], 0.0), None),
    ],
)
def test_the_simplest_right_formula_wins(
    screen: Screen, law: Callable[[Array, Array], Array], said: str | None
) -> None:
    m = screen.motion
    force = screen.weak(law(m.q, m.v))
    force += 1e-3 * np.std(force) * np.random.default_rng(0).standard_normal(len(force))
    data = ForceData(screen, "j1", force, np.ones(len(force), bool), 0, STEP)
    names = ["qvel/j1"] if said is None or "j2" not in said else ["qvel/j1", "qpos/j2"]
    fit = sparse(data, names)
    assert fit.r2 > 0.999
    assert len(fit.terms) == (2 if said is None else 1)
    assert said in (None, solve(data, fit).text())
