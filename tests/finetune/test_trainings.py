"""Trainings side by side, with models from folders, within a time, and without MLflow."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from tests.finetune.conftest import TINY, MakeModel
from wt.cli.finetune import main
from wt.finetune import trainings
from wt.finetune.config import Finetune
from wt.finetune.trainings import Job, Judged, Orders, begin_work, jobs_of, threads_of_each
from wt.locomotion import evaluate, train
from wt.locomotion.export import Origin
from wt.run.study import Listener, Silent

WORDS = ["--config", "conf/finetune_go2.yaml", *TINY, "variants=[none,translation]"]
BRIEF = {"SETTLE_SECONDS": 0.2, "TRACK_SECONDS": 1.0, "WALK_SECONDS": 1.0}


def brief_work(orders: Orders, listener: Listener, index: int) -> Callable[[Job], Judged | None]:
    """The same with the card's evaluation in a second instead of a minute, in any process."""
    for name, seconds in BRIEF.items():
        setattr(evaluate, name, seconds)
    return begin_work(orders, listener, index)


@pytest.fixture(autouse=True)
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in BRIEF.items():
        monkeypatch.setattr(evaluate, name, seconds)
    monkeypatch.setattr(trainings, "begin_work", brief_work)


@pytest.fixture
def no_mlflow(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "mlflow"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mlflow", None)  # whoever imports it, fails


def results(out: Path) -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = json.loads((out / "results.json").read_text())["variants"]
    return found


@pytest.mark.long
@pytest.mark.usefixtures("no_mlflow")
def test_side_by_side_and_one_by_one_come_to_the_same(
    tmp_path: Path, make_model: MakeModel, capsys: pytest.CaptureFixture[str]
) -> None:
    """Models are of folders, and nothing imports mlflow."""
    model = make_model()
    (model / "results.json").write_text("{}")  # as in what wt fit leaves
    words = [*WORDS, f"model={model}", "variants=[randomization,translation]"]
    found = []
    for workers in (1, 2):
        out = tmp_path / f"workers-{workers}"
        assert main([*words, f"workers={workers}", "--out", str(out)]) == 0
        assert capsys.readouterr().out.endswith(f"\nfiles in {out}\n")
        assert not (out / "mlflow_run_id").exists()
        card = json.loads((out / "translation-seed0" / "card.json").read_text())
        assert card["sources"]["model"] and card["training"]["iterations"] == 2
        found.append((results(out), card["evaluation"], card["config"]))
    assert found[0] == found[1]
    assert [row["updates"] for row in found[0][0].values()] == [[2], [2]]


def test_mlflow_is_not_imported_beforehand_either() -> None:
    code = "import sys; sys.modules['mlflow'] = None; import wt.finetune.job"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]


def test_a_folder_that_is_tracked(
    tmp_path: Path, make_model: MakeModel, capsys: pytest.CaptureFixture[str]
) -> None:
    store = [f"tracking.uri=sqlite:///{tmp_path}/mlflow.db", "variants=[none]"]
    words = [*WORDS, f"model={make_model()}", *store, "--out", str(tmp_path / "run")]
    assert main([*words, "--track"]) == 0
    run_id = (tmp_path / "run" / "mlflow_run_id").read_text()
    assert f"run {run_id} in sqlite:///" in capsys.readouterr().out


def test_folders_that_are_no_model_of_this_robot_are_refused(
    tmp_path: Path, make_model: MakeModel, capsys: pytest.CaptureFixture[str]
) -> None:
    changed, empty = make_model(), tmp_path / "empty"
    with (changed / "model.onnx").open("ab") as file:
        file.write(b"x")
    empty.mkdir()
    for folder, said in (
        (tmp_path / "none", "is no folder, and no model of the registry either"),
        (empty, "has no card.json; a model is a folder with model.onnx and card.json"),
        (changed, f"{changed}/model.onnx has sha256"),
        (make_model(task="g1_flat"), "its task is 'g1_flat', the configuration's 'go2_payload'"),
    ):
        out = tmp_path / "run"
        assert main([*WORDS, f"model={folder}", "--out", str(out)]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ") and error.count("\n") == 1
        assert said in error and not (out / "config.yaml").exists()


def test_an_error_in_one_training_is_a_line_and_the_others_finish(
    tmp_path: Path, make_model: MakeModel, capsys: pytest.CaptureFixture[str]
) -> None:
    out, words = tmp_path / "run", [*WORDS, f"model={make_model()}"]
    (out / "translation-seed0").mkdir(parents=True)
    (out / "translation-seed0" / "checkpoint.pt").write_bytes(b"no checkpoint")
    assert main([*words, "--out", str(out)]) == 1
    said = capsys.readouterr()
    warning, error = said.err.splitlines()
    assert warning.startswith("warning: translation-seed0: ")
    assert error.startswith("error: translation-seed0: ") and "--resume --out" in error
    assert "| none |" in said.out and list(results(out)) == ["none"]


class Clock:
    """A clock of which every look at it takes 100 s."""

    def __init__(self) -> None:
        self._now = 0.0

    def monotonic(self) -> float:
        """The time [s]."""
        self._now += 100.0
        return self._now


def test_a_time_limit_ends_trainings_between_two_updates_and_a_resumed_run_goes_on(
    tmp_path: Path,
    make_model: MakeModel,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, words = tmp_path / "run", [*WORDS, f"model={make_model()}"]
    with monkeypatch.context() as patch:
        patch.setattr(train, "time", Clock())
        assert main([*words, "--out", str(out), "--time-limit", "7"]) == 0
    assert results(out)["translation"]["updates"] == [1]
    assert "| updates |" in capsys.readouterr().out
    kept = ["--config", str(out / "config.yaml"), "--out", str(out), "--resume"]
    assert main(kept) == 0
    assert results(out)["translation"]["updates"] == [2]
    assert "| updates |" not in capsys.readouterr().out


def test_what_has_not_begun_in_time_is_not_in_the_table(
    tmp_path: Path,
    make_model: MakeModel,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "run"
    words = [*WORDS, f"model={make_model()}", "--out", str(out), "--time-limit", "0.01"]
    # by the time that trainings look at the clock, the limit is over
    monkeypatch.setattr(trainings, "time", SimpleNamespace(time=lambda: math.inf))
    assert main(words) == 0
    assert "warning: translation-seed0: no update began in time" in capsys.readouterr().err
    assert list(results(out)) == ["none"]


def test_gpus_in_turn(tiny: Finetune, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[torch.device] = []
    cuda = SimpleNamespace(
        is_available=lambda: True, device_count=lambda: 2, set_device=taken.append,
        current_device=lambda: taken[-1].index,
    )  # fmt: skip
    for name, stub in vars(cuda).items():
        monkeypatch.setattr(torch.cuda, name, stub)
    orders = Orders(tiny, Path(), Origin("", ""))
    for index in range(3):
        setting = begin_work(orders, Silent(), index).args[1]  # type: ignore[attr-defined]
        assert train.choose_device(setting.training("none", 0)) == f"cuda:{index % 2}"


def test_cores_are_shared(tiny: Finetune, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 16)
    assert threads_of_each(1, 8, 1) == threads_of_each(0, 1, 1) == 0  # all that there are
    assert threads_of_each(4, 8, 1) == 4 and threads_of_each(4, 8, 2) == 2
    assert threads_of_each(0, 40, 1) == 1


def test_seeds_are_begun_one_after_the_other(tiny: Finetune) -> None:
    tiny.seeds = [3, 4]
    assert list(map(str, jobs_of(tiny))) == [
        "none-seed3", "randomization-seed3", "translation-seed3",
        "randomization-seed4", "translation-seed4",
    ]  # fmt: skip
