"""The whole of a diagnosis on concealed worlds, whose physics is none of ours, and on bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from tests.diagnose import hidden_forces
from wt.diagnose import pipeline
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.pace import Pace
from wt.diagnose.pipeline import diagnose
from wt.diagnose.residual.screen import Screen
from wt.diagnose.result import Diagnosis
from wt.diagnose.selection import naming as naming_module
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import Holdout
from wt.diagnose.selection.memory import Memory
from wt.diagnose.selection.naming import Naming
from wt.errors import RecordingError, UserError
from wt.physics.planted import Hypothesis, Planted
from wt.physics.scene import Scene
from wt.prove.cases import Case, cases
from wt.prove.score import score
from wt.prove.world import HiddenWorld, build
from wt.types import Recording

SEED = 2


def case_named(part: str) -> Case:
    # recordings of half a trial's length: what is looked for here is plain
    return replace(next(c for c in cases("full", SEED) if part in c.name), seconds=8.0)


def model_of(world: HiddenWorld, folder: Path) -> Path:
    path = folder / "robot.xml"
    path.write_text(world.nominal_xml)
    return path


def diagnosed(case: Case, folder: Path) -> Diagnosis:
    world = build(case)
    return diagnose(model_of(world, folder), world.fit, holdout=world.holdout)


def test_a_hidden_effect_is_named_and_its_size_found(tmp_path: Path) -> None:
    case = case_named("pendulum-joint.friction_viscous")
    found = diagnosed(case, tmp_path)
    marks = score(found.to_json(), case)
    assert marks.location
    assert marks.effect
    assert max(marks.errors.values()) < 0.1
    after, before = found.proof.holdout.after, found.proof.holdout.before
    assert after < 0.5 * before
    # the patch is plain MJCF, and what changed says why
    patched = mujoco.MjModel.from_xml_string(found.patched_xml)
    assert patched.nq == 1
    assert found.findings[0].statement in found.patched_xml
    json.dumps(found.to_json())


def test_nothing_is_said_where_nothing_is_hidden(tmp_path: Path) -> None:
    found = diagnosed(case_named("pendulum-nothing"), tmp_path)
    assert found.findings == ()
    assert found.verdict == "no_mismatch"
    if not any("time step" in note for note in found.notes):
        assert found.patched_xml == (tmp_path / "robot.xml").read_text()


def test_the_same_seed_says_the_same(tmp_path: Path) -> None:
    world = build(case_named("pendulum-tight_servo"))
    model = model_of(world, tmp_path)
    said = [diagnose(model, world.fit[:1]).to_json() for _ in range(2)]
    assert said[0] == said[1]


@pytest.fixture(scope="module")
def still() -> HiddenWorld:
    return build(case_named("pendulum-nothing"))


def changed(recording: Recording, **columns: np.ndarray) -> Recording:
    names = {name.replace("__", "/"): values for name, values in columns.items()}
    return Recording(recording.t, {**recording.columns, **names}, recording.meta)


def test_bad_recordings_are_one_line(still: HiddenWorld, tmp_path: Path) -> None:
    model = model_of(still, tmp_path)
    good = still.fit[0]
    empty = np.full(len(good), np.nan)
    foreign = Recording(good.t, {"ctrl/elsewhere": empty + 1.0, "qpos/nowhere": empty}, {})
    constant = {
        name: np.zeros(len(good)) for name in good.columns if name.startswith(("ctrl/", "qpos/"))
    }
    wrong = {
        "names nothing in the model": foreign,
        "has no finite value": changed(good, qpos__hinge=empty),
        "degrees": changed(good, qpos__hinge=np.degrees(good.columns["qpos/hinge"])),
        "nothing is excited": Recording(good.t, constant, {}),
    }
    for message, recording in wrong.items():
        with pytest.raises(RecordingError, match=message) as caught:
            diagnose(model, [recording])
        assert "\n" not in str(caught.value)
    with pytest.raises(UserError, match="at least one"):
        diagnose(model, [])


@pytest.mark.parametrize(("proven", "searches"), [("simpler law", 1), ("", pipeline.ATTEMPTS)])
def test_only_an_effect_that_was_refused_starts_another_search(
    proven: str, searches: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def standing(name: str) -> tuple[Mock, ...]:
        return (Mock(spec=Accepted, planted=Mock(spec=Planted, key=name)),) if name else ()

    searched: list[set[str]] = []

    def search(*args: object) -> tuple[Accepted, ...]:
        banned = args[5] if len(args) > 5 else set()
        assert isinstance(banned, set)
        searched.append(set(banned))
        return standing(f"law {len(searched)}")

    monkeypatch.setattr(pipeline, "search", search)
    naming = Mock(spec=Naming, screen=Mock(spec=Screen), search_replays=Mock(spec=Objective))
    naming.log = DecisionLog()
    naming.proven.return_value = Mock(spec=Claims, accepted=standing(proven))
    naming.clean.return_value = False
    naming.further.side_effect = lambda earlier, later: later
    first = search()
    pipeline._proven(naming, first, Mock(spec=Pace))
    assert len(searched) == searches
    assert searched[-1] == {f"law {i}" for i in range(1, searches)}


def test_another_search_remembers_what_was_tried_before(monkeypatch: pytest.MonkeyPatch) -> None:
    screen, replays, held = Mock(spec=Screen), Mock(spec=Objective), Mock(spec=Holdout)
    naming = Naming(screen, replays, replays, lambda: replays, held, 1e-3, 0, DecisionLog())
    assert isinstance(naming.memory, Memory) and naming.memory is naming.memory
    memories: list[object] = []
    monkeypatch.setattr(pipeline, "search", lambda *args: memories.append(args[6]) or ())
    refused = (Mock(spec=Accepted, planted=Mock(spec=Planted, key="law")),)
    monkeypatch.setattr(Naming, "proven", lambda *_: Mock(spec=Claims, accepted=()))
    monkeypatch.setattr(Naming, "clean", lambda *_: False)
    monkeypatch.setattr(Naming, "further", lambda _, earlier, later: later)
    pipeline._proven(naming, refused, Mock(spec=Pace))
    assert memories == [naming.memory]  # it finds nothing, and nothing is refused


def test_what_was_proven_stays_though_what_took_its_place_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A bias gives way to a lag in a search, and then the lag is refused: the bias was right."""

    def claims(*names: str) -> Mock:
        accepted = tuple(Mock(spec=Accepted, planted=Mock(spec=Planted, key=n)) for n in names)
        return Mock(spec=Claims, accepted=accepted)

    both, lone = claims("friction", "bias"), claims("friction")
    starts: list[set[str]] = []

    def search(*args: object) -> tuple[Mock, ...]:
        start, banned = args[4], args[5]
        assert isinstance(start, tuple) and isinstance(banned, set)
        starts.append({a.planted.key for a in start})
        return tuple(claims("friction", f"lag {len(starts)}").accepted)

    monkeypatch.setattr(pipeline, "search", search)
    naming = Mock(spec=Naming, screen=Mock(spec=Screen), search_replays=Mock(spec=Objective))
    naming.log, naming.clean.return_value = DecisionLog(), False
    naming.proven.side_effect = [both, lone, lone]
    naming.further.side_effect = lambda earlier, later: max(
        earlier, later, key=lambda c: len(c.accepted)
    )
    first = tuple(claims("friction", "bias", "delay").accepted)
    assert pipeline._proven(naming, first, Mock(spec=Pace)) is both
    assert starts == [{"friction", "bias"}, {"friction", "bias"}]


@pytest.mark.parametrize(("lead", "stays"), [(3.0, False), (-3.0, True)])
def test_what_was_proven_later_has_to_be_more_likely(
    lead: float, stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    likely = {"later": 100.0 + lead, "earlier": 100.0}
    monkeypatch.setattr(naming_module, "merit", lambda objective, fit: likely[fit.hypothesis])
    objective = Mock(spec=Objective)
    objective.reference.side_effect = lambda hypothesis, tolerances: Mock(hypothesis=hypothesis)
    objective.evaluate.side_effect = lambda hypotheses, tolerances: [Mock(hypothesis=hypotheses[0])]
    two = [
        Mock(spec=Claims, accepted=(), estimated=Mock(hypothesis=n, assessed=Mock(hypothesis=n)))
        for n in likely
    ]
    naming = Mock(spec=Naming, objective=objective, log=DecisionLog())
    kept = Naming.further(naming, earlier=two[1], later=two[0])
    assert kept is two[1] if stays else kept is two[0]
    # replays are linear around what is gone on with
    assert objective.reference.call_args.args[0] == ("earlier" if stays else "later")


@pytest.mark.parametrize(("coarse", "finer"), [(3e-3, True), (5e-4, False)])
def test_a_step_is_refined_only_if_that_comes_nearer_to_the_robot(
    coarse: float, finer: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A simulator's robot may take the model's own coarse steps, which finer ones would miss."""
    path = tmp_path / "chain.xml"
    path.write_text(hidden_forces.chain(2).replace('timestep="0.0005"', 'timestep="0.002"'))
    leaves = {2e-3: coarse, 5e-4: 2e-3}
    holdout = Mock(spec=Holdout, smoothed=Mock(noise=np.full(2, 1e-4)))

    def errors(_: Holdout, hypotheses: list[Hypothesis], step: float) -> np.ndarray:
        return np.full((len(hypotheses), 50, 2), leaves[step])

    monkeypatch.setattr(pipeline, "errors", errors)
    nothing = Mock(spec=Claims, hypothesis=())
    assert pipeline._too_coarse(Scene(path), holdout, nothing) is finer
