"""What held-out data refuse is given up, at the price of fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, chain, on_joint, world
from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.likelihood.objective import Assessed
from wt.diagnose.selection import naming
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.alternatives import Lookalikes
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import Gain
from wt.diagnose.selection.naming import Naming
from wt.diagnose.selection.rivalry import Rivalry
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.force import Unknown, UnknownForce
from wt.diagnose.unknown.law import Atom, Law
from wt.physics.effect import effects
from wt.physics.planted import Key, Planted
from wt.types import Location


def found_at(*laws: tuple[str, str, float]) -> tuple[Accepted, ...]:
    """Effects at joints with figures, as a search finds them."""
    return tuple(
        Accepted(Planted(effects()[name], Location("joint", joint), np.array([size])), None, ())
        for name, joint, size in laws
    )


def test_of_several_that_are_refused_only_the_last_takes_an_estimate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing, log = world(tmp_path, 2, None, 2.5), DecisionLog()
    found = found_at(
        ("joint.friction_viscous", "j1", 0.01),
        ("joint.friction_viscous", "j2", 0.01),
        ("joint.armature", "j2", 0.001),
    )
    estimates, fits = Mock(wraps=naming.estimate), Mock(wraps=naming.fitted)
    monkeypatch.setattr(naming, "estimate", estimates)
    monkeypatch.setattr(naming, "fitted", fits)
    # intervals that hold nothing at all would drop each before it is asked
    monkeypatch.setattr(naming, "distances_from_nothing", lambda _: {})
    replays = nothing.objective
    proofs = Naming(nothing.screen, replays, replays, lambda: replays, nothing.held, STEP, 0, log)
    claims = proofs.proven(found, known={a.planted.key for a in found})
    assert claims.accepted == claims.gains == ()
    # one of each joint leaves, then the other of the second
    assert (estimates.call_count, fits.call_count) == (2, 1)
    refused = [d for d in log if d.stage == "holdout"]
    assert len(refused) == 3 and not any(d.kept for d in refused)


def test_what_gave_way_to_a_lookalike_that_is_refused_is_asked_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing, log = world(tmp_path, 2, None, 2.5), DecisionLog()
    found, lookalike = found_at(
        ("joint.friction_viscous", "j1", 0.01), ("joint.armature", "j1", 0.1)
    )
    replays = nothing.objective
    there = estimate(replays, (lookalike.planted,))
    monkeypatch.setattr(naming.Lookalikes, "settled", lambda *_: ((lookalike,), there))
    for name in ("simplified", "united"):
        monkeypatch.setattr(naming, name, lambda _, accepted, estimated, __: (accepted, estimated))
    monkeypatch.setattr(naming, "distances_from_nothing", lambda _: {})
    asked: list[dict[Key, float]] = []

    def judged(_: Naming, now: Assessed, limits: dict[Key, float]) -> tuple[list[Gain], list[int]]:
        asked.append(limits)
        weak = [i for i, p in enumerate(now.hypothesis) if p.key == lookalike.planted.key]
        return [Gain(0.1, 0.5 if weak else 1e-4)], weak

    monkeypatch.setattr(Naming, "_judged", judged)
    proofs = Naming(nothing.screen, replays, replays, lambda: replays, nothing.held, STEP, 0, log)
    claims = proofs.proven((found,))
    assert [a.planted.key for a in claims.accepted] == [found.planted.key]
    # held-out data were asked twice, which has to be paid
    assert [list(limits.values()) for limits in asked] == [
        [THRESHOLDS.significant], [THRESHOLDS.significant / 2]
    ]  # fmt: skip


def test_of_many_only_what_held_out_data_show_is_compared_with_lookalikes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    law = on_joint(0, lambda q, v: -0.6 * float(np.tanh(v / 0.01)))
    rubbing, log = world(tmp_path, 2, law, 4.0), DecisionLog()
    found = found_at(
        ("joint.friction_coulomb", "j1", 0.6),
        ("joint.friction_viscous", "j2", 0.3),
        ("joint.armature", "j2", 0.01),
        ("joint.friction_coulomb", "j2", 0.2),
    )
    compared: list[set[str]] = []

    def settled(_: Lookalikes, accepted: tuple[Accepted, ...], *rest: object) -> tuple[object, ...]:
        compared.append({str(a.planted) for a in accepted})
        return accepted, rest[0]

    monkeypatch.setattr(Lookalikes, "settled", settled)
    monkeypatch.setattr(naming, "fitted", lambda replays, parts, *_: replays.reference(parts))
    replays = rubbing.objective
    proofs = Naming(rubbing.screen, replays, replays, lambda: replays, rubbing.held, STEP, 0, log)
    claims = proofs.proven(found)
    assert compared[0] == {"joint.friction_coulomb at joint j1"}
    assert [str(a.planted) for a in claims.accepted] == ["joint.friction_coulomb at joint j1"]
    # what was proven before is asked in its turn
    proofs.proven(found, known={found[1].planted.key})
    assert "joint.friction_viscous at joint j2" in compared[1]


def test_a_name_is_compared_with_a_law_beside_the_tolerances_that_each_was_found_beside(
    tmp_path: Path,
) -> None:
    """A stage's friction by direction gave way to a law that had an error of the damping in it."""
    model = chain(1).replace('damping=".3"', 'damping="6"')
    machine = chain(1).replace('damping=".3"', 'damping="6.9"')
    rub = on_joint(0, lambda q, v: -0.6 * float(np.tanh(v / 0.01)))
    rubbing = world(tmp_path, 1, rub, 8.0, model=model, machine=machine)
    replays = rubbing.objective
    found = found_at(("joint.friction_coulomb", "j1", 0.6))
    named = Claims(found, estimate(replays, (found[0].planted,)), (), ())
    terms = ((Atom(0, "sign", 0.0, 0.01),), (Atom(0, "linear"),))
    law = Law(("qvel/j1",), np.array([-9.0]), np.array([9.0]), terms, np.array([-0.5, -1.0]))
    planted = Planted(UnknownForce(law, "unknown"), Location("joint", "j1"), np.ones(1))
    unknown = Unknown(planted, law.columns, law.text(), b"", 1.0, "", Gain(0.9, 0.0), 0.9)
    unnamed = Claims((), estimate(replays, ()), (), (unknown,))
    log = DecisionLog()
    proofs = Naming(rubbing.screen, replays, replays, lambda: replays, rubbing.held, STEP, 0, log)
    assert not proofs._better(unnamed, named)
    (said,) = [d for d in log if d.stage == "doubted"]
    assert said.reason == "no better than the names"


def test_names_with_times_among_them_have_to_be_better_than_the_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A push and a bias, no better than the law, were kept in the place of a rubber buffer."""
    nothing = world(tmp_path, 1, None, 2.5)
    replays, log = nothing.objective, DecisionLog()
    monkeypatch.setattr(naming, "lead_with_tolerances", lambda *_: Gain(0.5, 0.2))
    rub = found_at(("joint.friction_coulomb", "j1", 0.6))
    (push,) = found_at(("joint.force_intermittent", "j1", 0.5))
    terms = ((Atom(0, "linear"),),)
    law = Law(("qpos/j1",), np.array([-1.0]), np.array([1.0]), terms, np.array([-1.0]))
    planted = Planted(UnknownForce(law, "unknown"), Location("joint", "j1"), np.ones(1))
    unknown = Unknown(planted, law.columns, law.text(), b"", 1.0, "", Gain(0.9, 0.0), 0.9)
    unnamed = Claims((), estimate(replays, ()), (), (unknown,))
    proofs = Naming(nothing.screen, replays, replays, lambda: replays, nothing.held, STEP, 0, log)
    monkeypatch.setattr(Naming, "_theirs", lambda *_: False)
    for found, given_up in ((rub, False), ((*rub, push), True)):
        assessed = replays.reference(tuple(a.planted for a in found))
        named = Claims(found, replace(unnamed.estimated, assessed=assessed), (), ())
        assert proofs._better(unnamed, named) is given_up


def test_of_a_name_that_is_doubted_and_kept_the_last_word_is_that_it_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``--why`` ended with a name being given up that was a finding."""
    nothing = world(tmp_path, 1, None, 2.5)
    replays, log = nothing.objective, DecisionLog()
    rub = found_at(("joint.friction_coulomb", "j1", 0.6))
    named = Claims(rub, estimate(replays, tuple(a.planted for a in rub)), (), ())
    proofs = Naming(nothing.screen, replays, replays, lambda: replays, nothing.held, STEP, 0, log)
    far = Rivalry(0.3, 50.0, 0.6, ("qvel/j1",))
    monkeypatch.setattr(naming, "rivals_nonparametric", lambda *_, **__: far)
    monkeypatch.setattr(Naming, "proven", lambda *_, **__: replace(named, accepted=()))
    monkeypatch.setattr(Naming, "_with_unknown", lambda _, claims, *__: claims)
    assert proofs._doubted(named) is named
    said = [(d.stage, d.kept) for d in log if d.effect == "joint.friction_coulomb"]
    assert said == [("doubted", False), ("doubted", True)]


def test_several_names_that_fall_short_beside_something_unknown_are_doubted_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing, log = world(tmp_path, 2, None, 2.5), DecisionLog()
    replays = nothing.objective
    proofs = Naming(nothing.screen, replays, replays, lambda: replays, nothing.held, STEP, 0, log)
    two_at_one = found_at(
        ("joint.friction_viscous", "j1", 0.01),
        ("joint.armature", "j1", 0.01),
        ("joint.friction_viscous", "j2", 0.01),
    )
    force = Law(
        ("qvel/j1",), np.array([-1.0]), np.array([1.0]), ((Atom(0, "linear"),),), np.ones(1)
    )
    for joint, errs, doubted in (("j1", [0, 1], {0, 1}), ("j2", [0, 1], set()), ("j1", [1], set())):
        monkeypatch.setattr(naming, "erring_joints", lambda *_, errs=errs: errs)
        law = Planted(UnknownForce(force, ""), Location("joint", joint), np.ones(1))
        estimated = estimate(replays, tuple(a.planted for a in two_at_one))
        beside = Mock(spec=Unknown, planted=law)
        claims = Claims(two_at_one, estimated, (), (beside,))
        assert proofs._standing_in(claims) == doubted
