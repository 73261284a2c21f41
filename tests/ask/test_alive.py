"""A larger law that fits as well is alive, too: a machine may have it though none asks for it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ask.conftest import JOINT, RATE, XML
from wt.ask.alive import Alive, alive
from wt.ask.robot import SimulatedRobot
from wt.diagnose.pace import Pace
from wt.diagnose.pipeline import audited, searched
from wt.diagnose.selection.decisions import DecisionLog
from wt.types import Recording

DRY = 0.25  # N·m


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Alive, ...]:
    """Of an arm with dry friction that moved near level, where gravity's load hardly changes."""
    home = tmp_path_factory.mktemp("arm")
    (home / "arm.xml").write_text(XML)
    rubbed = XML.replace('damping=".3"', f'damping=".3" frictionloss="{DRY}"')
    (home / "world.xml").write_text(rubbed)
    t = np.arange(0.0, 8.0, 1.0 / RATE)
    u = 0.3 * np.sin(1.9 * t) + 0.2 * np.sin(4.3 * t)
    commands = Recording(t, {"ctrl/a": u, "qpos/j": np.zeros_like(u)})
    recording = SimulatedRobot(home / "world.xml", 1e-4, 0).perform(0, commands)
    pace = Pace(None, None)
    scene, prepared = audited(home / "arm.xml", [recording], [], pace)
    return alive(searched(scene, prepared, 0, DecisionLog(), pace))


def test_friction_may_grow_with_a_load_that_hardly_changed(found: tuple[Alive, ...]) -> None:
    claimed, *others = found
    assert [p.key for p in claimed.hypothesis] == [("joint.friction_coulomb", "joint", "j")]
    assert claimed.hypothesis[0].theta == pytest.approx([DRY], rel=0.1)
    larger = {a.differs.effect.id: a for a in others if a.larger and a.differs}
    assert "joint.friction_load" in larger
    law = larger["joint.friction_load"]
    assert law.differs is not None and law.differs.at == JOINT
    assert law.spread[1] > 0.0, "how much of it grows with the load is not known"


def test_no_law_is_alive_that_fits_worse(found: tuple[Alive, ...]) -> None:
    names = {a.differs.effect.id for a in found[1:] if a.differs}
    assert not names & {"joint.stiffness", "actuator.gain", "joint.armature"}
