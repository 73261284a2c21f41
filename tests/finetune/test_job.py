"""``wt-finetune`` from end to end in seconds, what it leaves behind, and what it refuses."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import onnx
import pytest
from mlflow import MlflowClient

from registry.backend import NOTE
from tests.finetune.conftest import TINY
from wt.cli.finetune import main
from wt.locomotion import evaluate
from wt.run.track import source
from wt.worlds.policy import Policy
from wt.worlds.robots import GO2

Register = Callable[..., list[str]]

WORDS = ["--config", "conf/finetune_go2.yaml", *TINY]


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """The card's evaluation in a second instead of a minute."""
    for name, seconds in (("SETTLE_SECONDS", 0.2), ("TRACK_SECONDS", 1.0), ("WALK_SECONDS", 1.0)):
        monkeypatch.setattr(evaluate, name, seconds)


@pytest.mark.usefixtures("brief")
def test_the_whole_of_it(
    tmp_path: Path, registered: Register, capsys: pytest.CaptureFixture[str]
) -> None:
    out, model = tmp_path / "run", registered()
    words = [*WORDS, *model, "variants=[none,translation]", "--out", str(out)]
    assert main(words) == 0
    assert "| translation |" in capsys.readouterr().out
    results = json.loads((out / "results.json").read_text())
    assert list(results["variants"]) == ["none", "translation"]
    assert results["paper"]["translation"]["tracking"] == 0.1786
    assert "-" in (out / "results.md").read_text()
    home = out / "translation-seed0"
    card = Policy.load(home, GO2).card
    assert (card.name, card.training["iterations"]) == ("go2_payload_translation", 2)
    assert len(card.evaluation["tracking"]) == 6
    assert card.made_by.startswith("wt-finetune --config")
    base = Policy.load("go2_payload", GO2).card
    translated = hashlib.sha256((out / "model-translation" / "model.onnx").read_bytes())
    assert card.task == "go2_payload"
    assert card.sources == {"start_policy": base.sha256, "model": translated.hexdigest()}
    run_id = (out / "mlflow_run_id").read_text()
    said = {p.key: p.value for p in onnx.load(home / "policy.onnx").metadata_props}
    assert said["run_path"] == f"fine-tuning/{run_id}"
    assert said["model_sha256"] == card.sources["model"]
    assert said["commit"] == source().commit
    assert (home / "rollout.rrd").stat().st_size > 10_000
    with (home / "training.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["iteration"]) for row in rows] == [1, 2]
    assert float(rows[0]["astray"]) == 0
    client = MlflowClient(tracking_uri=model[1].partition("=")[2])
    run = client.get_run((out / "mlflow_run_id").read_text())
    assert run.data.params["training.ppo.iterations"] == "2"
    assert run.data.tags["task"] == "go2_payload" and "translation" in run.data.tags[NOTE]
    assert "system/cpu_utilization_percentage" in run.data.metrics
    assert run.data.metrics["translation-seed0/reward"] == pytest.approx(
        float(rows[1]["reward"]), rel=1e-4
    )
    tracking = results["variants"]["translation"]["tracking"]["mean"]
    assert run.data.metrics["translation/tracking"] == pytest.approx(tracking)

    assert main(words) == 2
    assert "already holds a run" in capsys.readouterr().err
    # what was interrupted before the export goes on from its checkpoint, and ends where it would
    (home / "card.json").unlink()
    kept = ["--config", str(out / "config.yaml"), "--out", str(out), "--resume"]
    assert main(kept) == 0
    assert Policy.load(home, GO2).card.sha256 == card.sha256
    again = json.loads((out / "results.json").read_text())
    assert again["variants"] == results["variants"]
    assert main([*kept, "seeds=[1]"]) == 2
    assert "the configuration differs" in capsys.readouterr().err


def refused(capsys: pytest.CaptureFixture[str], words: list[str], *said: str) -> None:
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1
    for part in said:
        assert part in error


def test_a_model_that_is_not_there_is_refused(
    tmp_path: Path, registered: Register, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "run")]
    nowhere = ["tracking.uri=sqlite:///none.db", *out]
    refused(capsys, [*WORDS, *nowhere], "no model store at", "wt fit")
    _, store = registered()
    refused(capsys, [*WORDS, store, *out], "no model 'wt-go2-concealed-20min'")
    assert not (tmp_path / "run" / "config.yaml").exists()


def test_a_model_of_another_task_or_joint_order_is_refused(
    tmp_path: Path, registered: Register, capsys: pytest.CaptureFixture[str], tiny: object
) -> None:
    out = ["--out", str(tmp_path / "run")]
    other = registered(task="go2_flat")
    refused(capsys, [*WORDS, *other, *out], "its task is 'go2_flat'", "'go2_payload'")
    turned = tuple(reversed(Policy.load("go2", GO2).card.joints))
    words = registered(joints=turned)
    refused(capsys, [*WORDS, *words, *out], "joint order is RR_calf_joint at number 0")


def test_resuming_nothing_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, [*WORDS, "--resume"], "--resume needs --out")
    refused(capsys, [*WORDS, "--resume", "--out", str(tmp_path)], "holds no run")
