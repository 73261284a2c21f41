"""A whole trial, with a contender that is quick: what is sealed, recorded, refused and scored."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from wt.errors import ConfigError, DataError, WorkError
from wt.prove import bench, blind, folder, results
from wt.prove.bring import seal_all
from wt.prove.cases import Case, HiddenEffect, cases
from wt.prove.folder import Folder, Plan
from wt.prove.seal import new_key, read_key
from wt.prove.sensing import Sensing
from wt.prove.world import build

WHO = "coulomb"


def short() -> list[Case]:
    """A pendulum with dry friction, and one with nothing."""
    sensing = Sensing(rate=100.0, bits=17, noise=1e-4, qvel="none")
    effect = "joint.friction_coulomb"
    truth = HiddenEffect(effect, "joint", "hinge", {"coulomb": 0.6}, effect)
    motions = ("multisine", "triangle", "chirp")
    return [
        Case("003-friction", "pendulum", 3, "single", (truth,), sensing, motions, 3.0),
        Case("125-nothing", "pendulum", 5, "null", (), sensing, motions, 3.0),
    ]


def silent(what: str, share: float) -> None:
    assert 0.0 <= share <= 1.0, what


def plan(brought: str = "") -> Plan:
    return Plan("full", "", 0, (WHO,), brought, "this code")


def run(trial: Folder) -> None:
    bench.make(trial, 2, silent)
    bench.diagnose(trial, 2, silent)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trial whose diagnoses are written and recorded, its seals closed."""
    path = tmp_path_factory.mktemp("trial") / "trial"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "cases", lambda set, seed: short())
        patch.setattr(folder, "code", lambda: "this code")
        run(Folder.begin(path, plan()))
    return path


@pytest.fixture
def trial(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    """A copy of it."""
    monkeypatch.setattr(bench, "cases", lambda set, seed: short())
    monkeypatch.setattr(folder, "code", lambda: "this code")
    shutil.copytree(finished, tmp_path / "copy")
    return Folder.resume(tmp_path / "copy")


@pytest.mark.long
def test_a_robot_that_cannot_stand_is_left_out_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crushed = next(c for c in cases("legged", 0) if c.truth[0].effect == "body.payload_fixed")
    (load,) = crushed.truth
    load = replace(load, parameters={**load.parameters, "mass": 200.0})
    falls = replace(crushed, name="058-falls", truth=(load,), seconds=2.0)
    monkeypatch.setattr(bench, "cases", lambda set, seed: [falls, short()[1]])
    monkeypatch.setattr(folder, "code", lambda: "this code")
    trial = Folder.begin(tmp_path / "trial", plan())
    bench.make(trial, 1, silent)
    assert trial.left_out == ["058-falls"]
    assert sorted(trial.manifest) == sorted(path.name for path in trial.cases.iterdir())
    assert len(trial.manifest) == 1
    # where none can, there is nothing to prove
    monkeypatch.setattr(bench, "cases", lambda set, seed: [falls])
    with pytest.raises(WorkError, match=r"058-falls.*choose another seed"):
        bench.make(Folder.begin(tmp_path / "none", plan()), 1, silent)


def test_what_can_be_seen_says_nothing(trial: Folder) -> None:
    names = sorted(path.name for path in trial.cases.iterdir())
    assert len(names) == 2
    for name in names:
        files = sorted(path.name for path in (trial.cases / name).iterdir())
        assert files == ["answer.sealed", "commitment", "fit-1.parquet", "fit-2.parquet",
                         "holdout-1.parquet", "robot.xml"]  # fmt: skip
    sizes = {(trial.cases / name / "answer.sealed").stat().st_size for name in names}
    assert len(sizes) == 1
    told = "".join(path.read_text() for path in trial.cases.rglob("*.xml"))
    told += (trial.path / "manifest.json").read_text() + " ".join(names)
    assert "friction" not in told
    assert "003" not in " ".join(names)


def test_the_score(trial: Folder) -> None:
    answers = bench.opened(trial)
    found = results.score(trial, answers, 1, silent)
    assert json.loads((trial.path / "results.json").read_text()) == found
    marks = {row["name"][:3]: row["said"][WHO]["marks"] for row in found["cases"]}
    # who always says dry friction is right where there is some, and wrong where nothing is
    assert (marks["003"]["location"], marks["003"]["effect"]) == (True, True)
    assert marks["125"]["false_claims"] == 1
    scores = found["scores"][WHO]
    assert scores["effect"]["right"] == scores["effect"]["of"] == 1
    assert scores["false_alarms"]["share"] == 1.0
    assert scores["error_left"] < 0.5
    assert found["confusion"][WHO] == {
        "joint.friction_coulomb": {"joint.friction_coulomb": 1},
        "nothing": {"joint.friction_coulomb": 1},
    }
    opened = json.loads((trial.path / "answers.json").read_text())
    assert {case["answer"]["kind"] for case in opened["cases"].values()} == {"single", "null"}


def test_the_key_is_not_read_before_all_is_recorded(
    trial: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reads(*_: object) -> Any:  # noqa: ANN401 – never returns
        raise AssertionError("a seal was opened")

    (trial.path / "ledger.json").unlink()
    monkeypatch.setattr(bench, "unseal", reads)
    with pytest.raises(WorkError, match="not every diagnosis is written"):
        bench.opened(trial)


@pytest.mark.parametrize("what", ["diagnosis.json", "model.xml", "ran.json", "one more"])
def test_nothing_is_scored_that_was_changed_afterwards(trial: Folder, what: str) -> None:
    name = next(iter(trial.manifest))
    if what == "one more":
        shutil.rmtree(trial.said(WHO, name))
    else:
        file = trial.said(WHO, name) / what
        file.write_text(file.read_text() + " ")
    with pytest.raises(WorkError, match=r"changed after ledger.json was written"):
        bench.opened(trial)


def test_changed_cases_and_other_keys_are_refused(trial: Folder) -> None:
    with pytest.raises(DataError, match="does not open: the key is another one"):
        bench.opened(trial, new_key())
    file = next(trial.cases.glob("*/robot.xml"))
    file.write_text(file.read_text() + "<!-- -->")
    with pytest.raises(DataError, match=r"robot.xml' is not what .*manifest.json names"):
        _ = Folder.resume(trial.path).manifest


def test_an_interrupted_trial_goes_on(trial: Folder) -> None:
    """What is there is kept, what is missing is made again: the same cases, with the same key."""
    first, second = trial.manifest
    (trial.path / "ledger.json").unlink()
    shutil.rmtree(trial.said(WHO, second))
    before = {path: path.stat().st_mtime_ns for path in trial.said(WHO, first).iterdir()}
    run(Folder.resume(trial.path))
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert bench.opened(trial)
    (trial.path / "ledger.json").unlink()
    (trial.path / "manifest.json").unlink()
    shutil.rmtree(trial.cases / first)
    run(Folder.resume(trial.path))
    assert set(Folder.resume(trial.path).manifest) == {first, second}
    assert bench.opened(Folder.resume(trial.path))


def test_folders_are_claimed(
    trial: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match="not empty; add --resume"):
        Folder.begin(trial.path, plan())
    with pytest.raises(DataError, match="holds no trial"):
        Folder.resume(tmp_path)
    (trial.path / "ledger.json").unlink()
    monkeypatch.setattr(folder, "code", lambda: "other code")
    with pytest.raises(DataError, match="the code has changed"):
        Folder.resume(trial.path)


def brought(home: Path) -> Path:
    """A folder of cases as somebody else would make it, and their answers beside it."""
    from wt.data import recording

    answers = {}
    for name, case in zip(("left", "right"), short(), strict=True):
        world, folder = build(case), home / "cases" / name
        folder.mkdir(parents=True)
        (folder / "robot.xml").write_text(world.nominal_xml)
        recording.write(world.fit[0], folder / "fit-1.parquet")
        recording.write(world.holdout[0], folder / "holdout-1.parquet")
        answers[name] = {
            "truth": [
                {"effect": t.effect, "at": {"kind": t.kind, "name": t.name},
                 "parameters": t.parameters}
                for t in case.truth
            ]
        }  # fmt: skip
    file = home.with_name("answers.json")
    file.write_text(json.dumps(answers))
    return file


@pytest.mark.long
def test_cases_of_others(tmp_path: Path) -> None:
    home = tmp_path / "theirs"
    key = read_key(str(seal_all(home, brought(home))))
    assert (tmp_path / "theirs.key").stat().st_mode & 0o77 == 0
    trial = Folder.begin(tmp_path / "trial", plan(str(home)))
    run(trial)
    assert not (trial.path / "key").exists()
    with pytest.raises(ConfigError, match="give --key"):
        bench.opened(trial)
    found = results.score(trial, bench.opened(trial, key), 1, silent)
    assert [(row["name"], row["kind"]) for row in found["cases"]] == [
        ("left", "single"), ("right", "null"),
    ]  # fmt: skip
    assert found["scores"][WHO]["effect"]["right"] == 1


def test_what_others_bring_is_checked(tmp_path: Path) -> None:
    home = tmp_path / "theirs"
    answers = brought(home)
    good = json.loads(answers.read_text())
    for wrong, said in (
        ({"left": good["left"]}, "one answer for each of the cases left, right"),
        (good | {"left": {}}, "answer of case 'left' cannot be read: 'truth' is missing"),
        (good | {"left": {"truth": [{"effect": "x"}]}}, "'at' is missing"),
    ):
        answers.write_text(json.dumps(wrong))
        with pytest.raises(DataError, match=said):
            seal_all(home, answers)
    answers.write_text(json.dumps(good))
    inside = home / "answers.json"
    shutil.copy(answers, inside)
    with pytest.raises(DataError, match="which is passed on"):
        seal_all(home, inside)
    (home / "cases" / "left" / "holdout-1.parquet").unlink()
    with pytest.raises(DataError, match=r"case 'left' needs robot.xml"):
        seal_all(home, answers)
    assert not (tmp_path / "theirs.key").exists()


def test_a_contender_that_fails_is_said(tmp_path: Path) -> None:
    case, key = short()[0], new_key()
    bench.make_one(case, tmp_path / "cases", key)
    home, out = tmp_path / "cases" / bench.alias(case.name, key), tmp_path / "said"

    def fails(fit: Sequence[str], holdout: Sequence[str]) -> list[str]:
        assert (fit, holdout) == (["fit-1.parquet", "fit-2.parquet"], ["holdout-1.parquet"])
        return ["wt.cli.main", "diagnose", "missing.xml", *fit, "--out", "out"]

    ((_, ran),) = blind.run([blind.DiagnosisJob(home, out, fails, (), 60.0)], 1)
    assert ran.error == "error: model 'missing.xml' does not exist; give an MJCF file"
    assert json.loads((out / "ran.json").read_text())["error"] == ran.error
