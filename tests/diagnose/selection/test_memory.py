"""What has been tried at a joint is not tried again while nothing changes there."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import World, world
from wt.diagnose.likelihood.objective import Assessed
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.selection.memory import Memory
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.types import Location


def rub(_: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Friction at two of three joints."""
    data.qfrc_applied[:] = -np.array([0.8, 0.5, 0.0]) * np.tanh(data.qvel / 0.01)


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world(tmp_path_factory.mktemp("rubbing"), 3, rub, 5.0)


def planted(name: str, joint: str, *theta: float) -> Planted:
    return Planted(effects()[f"joint.{name}"], Location("joint", joint), np.array(theta))


DRY_1, DRY_2 = (planted("friction_coulomb", joint, 0.3) for joint in ("j1", "j2"))
SPRING_2, ROTOR_2 = planted("stiffness", "j2", 0.1, 0.0), planted("armature", "j2", 1e-4)
HEAVY = Planted(effects()["body.mass"], Location("body", "link3"), np.array([1.1]))


def tried(rubbing: World, present: Hypothesis) -> tuple[Assessed, Memory, Assessed]:
    """A round that tries dry friction and a spring; the second joint's friction, as fitted."""
    objective = rubbing.objective
    now, memory = objective.reference(present), Memory(objective)
    starts = [p for p in (DRY_1, DRY_2, SPRING_2) if p not in present]
    fits = refine(objective, [(*present, p) for p in starts], [[len(present)]] * len(starts))
    memory.note(now, [(p, None) for p in starts], fits, memory.same(now))
    return now, memory, next(f for f in fits if f.hypothesis[-1].key == DRY_2.key)


def test_only_what_came_near_is_replayed_again_and_begins_where_it_was(rubbing: World) -> None:
    now, memory, dry = tried(rubbing, ())
    same = memory.same(now)
    assert same == {0, 1}  # at the third joint nothing was tried
    options = [(p, None) for p in (DRY_2, SPRING_2, ROTOR_2, HEAVY)]
    left = [p for p, _ in memory.narrowed(options, same)]
    assert [p.key for p in left] == [DRY_2.key, ROTOR_2.key, HEAVY.key]
    assert left[0] is dry.hypothesis[-1] and left[0].theta == pytest.approx([0.5], rel=0.1)


def test_what_joins_at_one_joint_leaves_the_others_as_they_were(rubbing: World) -> None:
    objective = rubbing.objective
    _, memory, _ = tried(rubbing, ())
    (with_it,) = refine(objective, [(planted("friction_coulomb", "j1", 0.8),)], [[0]])
    assert memory.same(objective.reference(with_it.hypothesis)) == {1}


def test_pairs_are_remembered_as_such(rubbing: World) -> None:
    objective = rubbing.objective
    now, memory = objective.reference(()), Memory(objective)
    (both,) = refine(objective, [(ROTOR_2, DRY_2)], [[0, 1]])
    memory.note(now, [(DRY_2, None), (ROTOR_2, None)], [both], ())
    assert memory.pairs({1}) == [both.hypothesis]
    assert memory.narrowed([(DRY_2, None), (ROTOR_2, None)], {1}) == []


def test_a_joint_is_asked_of_once_until_it_changes(rubbing: World) -> None:
    objective = rubbing.objective
    now, memory = objective.reference(()), Memory(objective)
    assert [memory.unasked(now, dof) for dof in (0, 1, 0, 1)] == [True, True, False, False]
    with_it = objective.reference((planted("friction_coulomb", "j1", 0.8),))
    assert [memory.unasked(with_it, dof) for dof in (0, 1, 0)] == [True, False, False]
