"""Forces with a hidden state, learned from worlds whose state is kept by code of this test."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import onnx
import pytest

from tests.diagnose.hidden_forces import STEP, Hidden, World, world
from wt.diagnose.unknown.force import Unknown, find
from wt.diagnose.unknown.law import Law
from wt.diagnose.unknown.memory import memory_of

STIFFNESS, CREEP_S = 3.0, 0.4
MASS, PACE, DAMPING = 0.03, 14.0, 0.05
TORQUE, BEAT = 0.3, 19.0


class Strap:
    """A spring that yields, on j2; slack when a recording begins."""

    def __init__(self) -> None:
        self.stretch = 0.0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if data.time <= 0.0:
            self.stretch = 0.0
        self.stretch += model.opt.timestep * (data.qvel[1] - self.stretch / CREEP_S)
        data.qfrc_applied[1] -= STIFFNESS * self.stretch


class Slosh:
    """A mass on a spring that j2 drags along."""

    def __init__(self) -> None:
        self.at, self.speed = 0.0, 0.0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if data.time <= 0.0:
            self.at, self.speed = float(data.qpos[1]), 0.0
        torque = MASS * PACE**2 * (data.qpos[1] - self.at)
        torque += 2 * DAMPING * PACE * MASS * (data.qvel[1] - self.speed)
        self.speed += model.opt.timestep * torque / MASS
        self.at += model.opt.timestep * self.speed
        data.qfrc_applied[1] -= torque


def beat(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Something that turns at its own pace."""
    data.qfrc_applied[1] += TORQUE * np.sin(BEAT * data.time + 0.7)


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[World, Unknown | None]]:
    """What is learned in each world."""
    hidden: dict[str, Hidden] = {"strap": Strap(), "slosh": Slosh(), "beat": beat}
    found = {}
    for name, law in hidden.items():
        w = world(Path(tmp_path_factory.mktemp(name)), 2, law, fitted=2 if law is beat else 1)
        each = find(w.screen, w.objective, w.objective.reference(()), w.held, step=STEP)
        found[name] = (w, next((u for u in each if u.proven), None))
    return found


def law_of(found: Unknown | None) -> Law:
    assert found is not None
    return found.planted.effect.law  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize("name", ["strap", "slosh", "beat"])
def test_it_is_found_and_improves_replays(
    learned: dict[str, tuple[World, Unknown | None]], name: str
) -> None:
    _, found = learned[name]
    assert found is not None
    assert str(found.planted.at) == "joint j2"
    assert found.r2 > 0.8
    assert found.gain.share > 0.6
    assert found.gain.p_value < 0.01
    assert set(found.depends_on) <= ({"t"} if name == "beat" else {"qpos/j2", "qvel/j2"})


def test_the_strap_is_the_one_that_was_hidden(
    learned: dict[str, tuple[World, Unknown | None]],
) -> None:
    law = law_of(learned["strap"][1])
    memory = memory_of(law.columns[0])
    assert memory is not None
    assert (memory.kind, memory.joint) == ("creep", "j2")
    assert memory.rate == pytest.approx(CREEP_S, rel=0.1)
    assert law.weights[0] == pytest.approx(-STIFFNESS, rel=0.1)


def test_the_liquid_is_the_one_that_was_hidden(
    learned: dict[str, tuple[World, Unknown | None]],
) -> None:
    law = law_of(learned["slosh"][1])
    memory = memory_of(law.columns[0])
    assert memory is not None
    assert memory.kind == "swing"
    assert memory.rate == pytest.approx(PACE, rel=0.1)
    assert law.weights[0] == pytest.approx(MASS * PACE**2, rel=0.2)


def test_the_pace_is_the_one_that_was_hidden(
    learned: dict[str, tuple[World, Unknown | None]],
) -> None:
    law = law_of(learned["beat"][1])
    assert law.columns == ("t",)
    (pace,) = {atom.b for atom in law.atoms}
    assert pace == pytest.approx(BEAT, rel=0.01)
    assert float(np.hypot(*law.weights)) == pytest.approx(TORQUE, rel=0.1)
    # it goes on for ever: a held-out recording may be longer
    late = law.force(np.array([[1e3], [1e3 + np.pi / pace]]))
    assert late[0] == pytest.approx(-late[1], abs=1e-6)


def test_the_graph_takes_what_remembers(
    learned: dict[str, tuple[World, Unknown | None]],
) -> None:
    found = learned["strap"][1]
    assert found is not None
    graph = onnx.load_from_string(found.onnx).graph
    assert [port.name for port in graph.input] == list(law_of(found).columns)
