"""Terms in the weak form are the same whoever asked for them before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import record
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.residual.screen import Screen
from wt.diagnose.unknown import terms
from wt.diagnose.unknown.law import Atom, Term
from wt.diagnose.unknown.terms import WeakTerms
from wt.physics.scene import Scene

LINK = """<mujoco><compiler angle="radian"/><option timestep=".002" integrator="implicitfast"/>
<worldbody><body><joint name="j1" axis="0 1 0" damping=".3"/>
<geom type="capsule" fromto="0 0 0 .03 .02 -.25" size=".03" mass="1"/></body></worldbody>
<actuator><position name="a1" joint="j1" kp="60" kv="3"/></actuator></mujoco>"""
NAMES = ["qpos/j1", "qvel/j1", "t"]
SPEED: Term = (Atom(1, "linear"),)
PRODUCT: Term = (Atom(0, "bump", 0.1, 0.2), Atom(1, "sign", 0.0, 0.05))
TERMS: list[Term] = [(), SPEED, (Atom(0, "sin", 0.0, 2.0),), PRODUCT, (*SPEED, Atom(2, "linear"))]


@pytest.fixture
def screen(tmp_path: Path) -> Screen:
    path = tmp_path / "link.xml"
    path.write_text(LINK)
    return Screen(smooth(Scene(path), [Part(record(LINK, None, 4.0, 0), 0)]))


def plain(screen: Screen) -> np.ndarray:
    m = screen.motion
    columns = np.stack([m.q[:, 0], m.v[:, 0], m.t], axis=1)
    factors = [[a.value(columns[:, a.column]) for a in term] for term in TERMS]
    values = np.stack([np.prod([np.ones(len(m)), *f], axis=0) for f in factors], axis=1)
    return screen.weak(values)


def test_in_any_order_and_company_to_the_bit(screen: Screen) -> None:
    known, wanted = WeakTerms(screen), plain(screen)
    assert (known.weak(NAMES, TERMS) == wanted).all()
    others = [PRODUCT, (Atom(1, "square"),), PRODUCT, ()]
    assert (known.weak(NAMES, others)[:, [0, 2, 3]] == wanted[:, [3, 3, 0]]).all()
    assert (known.weak(NAMES, TERMS) == wanted).all()


def test_a_column_is_its_name(screen: Screen) -> None:
    known = WeakTerms(screen)
    speed = known.weak(NAMES, [SPEED])
    position = known.weak(["qvel/j1", "qpos/j1"], [SPEED])
    again = known.weak(["qvel/j1"], [(Atom(0, "linear"),)])
    assert (speed == again).all() and not (position == speed).all()


def test_what_is_kept_is_bounded(screen: Screen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terms, "_LEAST", 2)
    monkeypatch.setattr(terms, "_BYTES", 0)
    known, wanted = WeakTerms(screen), plain(screen)
    for _ in range(2):
        assert (known.weak(NAMES, TERMS) == wanted).all()
        assert len(known._known) == 2
