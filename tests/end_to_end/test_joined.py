"""Both halves in one command, with a diagnosis that lies there already."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.end_to_end.conftest import Place, Wt
from tests.end_to_end.test_bad_input import assert_refused
from tests.worlds.walking.test_concealed import with_load
from wt import joined

STATEMENT = "Body base carries a load of 5 kg."


@pytest.fixture
def small(place: Place, tmp_path: Path) -> list[str]:
    """``wt fit`` on the concealed load, as small as can be."""
    config = tmp_path / "small.yaml"
    config.write_text(
        f"base: {place.conf / 'go2_concealed_debug.yaml'}\n"
        "world: {robots: 6, episode_steps: 110, timestep: 0.005, threads: 1}\n"
        f"data: {{dir: {tmp_path / 'data'}, transitions: 660, validation_pairs: 512, "
        "test_pairs: 660}\n"
        "workers: 1\ndiagnose: {rollouts: 6}\nbaselines: {names: [RawSim]}\n"
        "paper: &few\n  mean: {steps: 40}\n  train: {steps: 40, validate_every: 20}\nplus: *few\n"
    )
    return ["fit", "--config", str(config), "--out", str(tmp_path / "run")]


@pytest.mark.long
def test_translation_diagnosis_and_both(
    wt: Wt, small: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, asked = tmp_path / "run", []

    class Found:
        """What a diagnosis would have said and written."""

    def diagnosed(model: Path, fit: list[Path], holdout: list[Path], **_: object) -> Found:
        asked.append(model.name)
        assert [p.name for p in (*fit, *holdout)] == ["real_1.parquet", "real_2.parquet"]
        assert len(holdout) == 1 and all(p.is_file() for p in (*fit, *holdout))
        return Found()

    def written(found: Found, out: Path) -> None:
        out.mkdir()
        with_load(out, 5.0)
        said = {"verdict": "explained", "findings": [{"statement": STATEMENT}]}
        (out / "diagnosis.json").write_text(json.dumps(said))

    monkeypatch.setattr(joined, "PAST", 20)
    monkeypatch.setattr(joined, "diagnose", diagnosed)
    monkeypatch.setattr(joined, "write", written)
    code, out, err = wt(*small)
    assert code == 0, err
    assert STATEMENT in out and "translation on it, ours" in out
    said = json.loads((run / "joined.json").read_text())
    lines = {(x["simulator"], x["method"]): x for x in said["lines"]}
    assert len(lines) == 6
    # nothing is trained for these two: the load that S has now explains most of the difference
    given, patched = lines["as given", "RawSim"], lines["patched", "RawSim"]
    assert patched["single_step"] < 0.5 * given["single_step"]
    assert patched["rollout"] < given["rollout"]
    alone = json.loads((run / "results.json").read_text())["single_step"]
    assert lines["as given", "WorldTranslationPlus"]["single_step"] == pytest.approx(
        alone["WorldTranslationPlus"]["mse"]
    )
    assert (
        "model: " + str(run / "diagnosis" / "model.xml")
        in (run / "patched" / "config.yaml").read_text()
    )
    assert (
        (run / "joined.md")
        .read_text()
        .startswith("# go2_concealed\n\n| MSE of the state | one step |")
    )
    # again, after an interruption: nothing is diagnosed or trained anew
    (run / "joined.json").unlink()
    assert wt(*small, "--resume")[0] == 0
    assert json.loads((run / "joined.json").read_text()) == said and asked == ["simulator.xml"]


def test_a_model_of_another_robot_is_refused_before_anything_is_written(
    wt: Wt, place: Place, tmp_path: Path
) -> None:
    model = tmp_path / "model.xml"
    model.write_text("<mujoco><worldbody/></mujoco>")
    config = str(place.conf / "go2_concealed.yaml")
    words = ("fit", "--config", config, "--model", model, "--out", "refused")
    assert_refused(wt(*words), 2, "is no model of the go2: it has no joint 'base'")
    words = ("fit", *place.words, "--model", model, "--out", "refused")
    assert_refused(wt(*words), 2, "--model: the world 'r5' has no option world.model")
    assert not (place.home / "refused").exists()


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("diagnose.recordings=1", "diagnose.holdout 1 leaves none of diagnose.recordings 1"),
        ("diagnose.rollouts=0", "diagnose.rollouts is 0"),
        ("diagnose.recordngs=2", "did you mean 'recordings'?"),
    ],
)
def test_an_impossible_diagnosis_is_refused(wt: Wt, small: list[str], word: str, said: str) -> None:
    assert_refused(wt(*small, word), 2, said)


def test_a_world_that_cannot_be_recorded_is_refused(wt: Wt, place: Place) -> None:
    words = (*place.words, "diagnose.recordings=2", "--out", "refused")
    assert_refused(wt("fit", *words), 2, "diagnose: the world 'r5' cannot be recorded")
