"""A search never ends below a state that it has passed, and goes on without what misled it."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.diagnose.hidden_forces import on_joint, world
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.selection import search as search_module
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.search import _fitted, _foretold, _lesser, _prune, _State, uphill
from wt.diagnose.stop import StoppedError
from wt.physics.effect import effects
from wt.physics.planted import Key, Planted
from wt.types import Location

State = frozenset[Key]
COULOMB, ARMATURE, STOP = (
    (f"joint.{name}", "joint", "j1") for name in ("friction_coulomb", "armature", "stop")
)
ORDER = (COULOMB, ARMATURE, STOP)


class Ladder:
    """Rounds that add the first effect which is neither there nor refused."""

    def __init__(self, merit: dict[State, float]) -> None:
        self.merit, self.passed = merit, [State()]
        self.taken_back: list[tuple[set[Key], float]] = []

    def advance(self, state: State, refused: Container[Key]) -> tuple[State, set[Key]]:
        for key in ORDER:
            if key not in state and key not in refused:
                self.passed.append(state | {key})
                return state | {key}, {key}
        return state, set()

    def back(self, state: State, joined: set[Key], lead: float) -> State:
        self.taken_back.append((joined, lead))
        return state

    def lead(self, after: State, before: State) -> float:
        return self.merit[after] - self.merit[before]

    def end(self) -> State:
        return uphill(State(), self.advance, self.lead, set, self.back)


def test_a_round_downhill_is_taken_back() -> None:
    ladder = Ladder(
        {
            State(): 0.0,
            State({COULOMB}): 577.0,
            State({COULOMB, ARMATURE}): 563.0,
            State({COULOMB, STOP}): 629.0,
        }
    )
    assert ladder.end() == {COULOMB, STOP}
    assert ladder.taken_back == [({ARMATURE}, pytest.approx(-14.0))]


def test_it_ends_at_the_best_state_that_it_passed() -> None:
    subsets = [State(key for i, key in enumerate(ORDER) if k >> i & 1) for k in range(8)]
    for merits in np.random.default_rng(3).normal(size=(50, 8)):
        ladder = Ladder(dict(zip(subsets, merits.tolist(), strict=True)))
        best = max(ladder.merit[ladder.end()], -np.inf)
        assert best == max(ladder.merit[state] for state in ladder.passed)


def test_it_ends_where_nothing_new_lasts() -> None:
    replaced = uphill(
        State({COULOMB}), lambda s, _: (s, {ARMATURE}), lambda *_: 0.0, set, lambda s, *_: s
    )
    assert replaced == {COULOMB}


def test_an_end_before_its_time_gives_the_best_so_far() -> None:
    ladder = Ladder({State(ORDER[:k]): float(k) for k in range(4)})

    def advance(state: State, refused: Container[Key]) -> tuple[State, set[Key]]:
        if len(state) == 2:
            raise StoppedError
        return ladder.advance(state, refused)

    assert uphill(State(), advance, ladder.lead, set, ladder.back) == {COULOMB, ARMATURE}


def test_only_what_is_on_the_same_limb_adapts_to_what_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    parts = tuple(
        Planted(effects()["joint.friction_coulomb"], Location("joint", joint), np.ones(1))
        for joint in ("hip", "other_hip", "knee")
    )
    same_limb = {0: [0, 2], 1: [1]}
    asked: dict[str, object] = {}

    def refined(_: object, starts: object, free: object, **given: object) -> list[Assessed]:
        asked.update(starts=starts, free=free)
        return []

    monkeypatch.setattr(search_module, "together", lambda _, __, some: same_limb[some[0]])
    monkeypatch.setattr(search_module, "refine", refined)
    now = Mock(spec=Assessed, hypothesis=parts, tolerances=np.zeros(0))
    _lesser(Mock(spec=Objective, tolerances=()), now, [0, 1], {})
    hip, other, knee = parts
    assert asked == {"starts": [(other, knee), (hip, knee)], "free": [[1], []]}


def test_what_joints_do_not_need_leaves_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rubbing = on_joint(0, lambda q, v: -0.6 * float(np.tanh(v / 0.01)))
    objective, log = world(tmp_path, 2, rubbing, 4.0).objective, DecisionLog()
    laws = (
        ("friction_coulomb", 1),
        ("friction_viscous", 1),
        ("friction_viscous", 2),
        ("armature", 2),
    )
    sizes = (0.6, 1e-3, 1e-2, 1e-3)
    found = [
        Planted(effects()[f"joint.{name}"], Location("joint", f"j{i}"), np.array([size]))
        for (name, i), size in zip(laws, sizes, strict=True)
    ]  # fmt: skip
    left_out = Mock(wraps=_lesser)
    monkeypatch.setattr(search_module, "_lesser", left_out)
    accepted = [Accepted(p, (), ()) for p in found]
    end = _prune(objective, _State(accepted, _fitted(objective, tuple(found))), log)
    assert [str(p) for p in end.now.hypothesis] == ["joint.friction_coulomb at joint j1"]
    assert end.now.hypothesis[0].theta == pytest.approx([0.6], rel=0.05)
    assert [a.planted.key for a in end.accepted] == [p.key for p in end.now.hypothesis]
    # one of each joint, then the other of the second
    assert left_out.call_count == 2
    assert [d.stage for d in log] == ["pruned"] * 3


@pytest.mark.parametrize(
    ("p_values", "stays"), [([1.0, 0.9], False), ([1.0, 1e-4], True), ([], True)]
)
def test_many_effects_grow_only_by_what_recordings_foretell_of_each_other(
    p_values: list[float], stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [
        Planted(effects()[f"joint.{name}"], Location("joint", "hip"), np.ones(1))
        for name in ("armature", "friction_coulomb", "friction_viscous")
    ]
    accepted = [Accepted(p, (), ()) for p in found]
    state = _State(accepted, Mock(spec=Assessed, hypothesis=tuple(found)), {})
    said = Mock(side_effect=[Mock(p_value=p) for p in p_values])
    monkeypatch.setattr(search_module, "left_in_turn", said)
    monkeypatch.setattr(search_module, "all_slopes", lambda *_: {})
    joined, log = accepted[3 - len(p_values) :], DecisionLog()
    one, two = (
        Mock(spec=Objective, scene=Mock(free=(), joints=joints))
        for joints in (("hip",), ("a", "b"))
    )
    assert _foretold(one, state, joined, log) == stays
    assert [call.args[2] for call in said.call_args_list] == [1, 2][: len(p_values)]
    assert len(list(log)) == (0 if stays else 2)
    # few effects are not asked
    assert _foretold(two, state, joined, log) and said.call_count == len(p_values)
