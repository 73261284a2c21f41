"""Tracking on a sqlite store; what was logged is read back with MLflow's own client."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from wt.errors import ConfigError, WorkError
from wt.run import track

if TYPE_CHECKING:
    from mlflow import MlflowClient


@pytest.fixture(scope="module", autouse=True)
def quiet() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_DISABLE_TELEMETRY", "true")
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        yield


@pytest.fixture(scope="module")
def uri(tmp_path_factory: pytest.TempPathFactory) -> str:
    return f"sqlite:///{tmp_path_factory.mktemp('track')}/mlflow.db"


@pytest.fixture(scope="module")
def client(uri: str) -> MlflowClient:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def artifact(client: MlflowClient, run_id: str, path: str) -> Path:
    return Path(client.get_run(run_id).info.artifact_uri) / path


def test_everything_is_there_when_read_back(uri: str, client: MlflowClient, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    (tmp_path / "notes.txt").write_text("notes")
    with track.run("toy", "first", uri=uri) as run:
        run.params({f"group.key{i}": i for i in range(150)} | {"seeds": [0, 1]})
        for step in range(600):
            run.metrics({"a": step, "b/c": np.float32(0.5), "bad": float("nan")}, step)
        run.table("tables/results", [{"method": "A", "mse": np.float32(0.5)}, {"x": float("inf")}])
        run.figure(Figure(), "figures/empty.png")
        run.text("a: 1\n", "config.yaml")
        run.artifact(tmp_path / "notes.txt", "files")
    held = client.get_run(run.id)
    assert (held.info.status, held.info.run_name) == ("FINISHED", "first")
    assert len(held.data.params) == 151 and held.data.params["seeds"] == "[0, 1]"
    history = client.get_metric_history(run.id, "a")
    assert [(m.step, m.value) for m in history] == [(i, i) for i in range(600)]
    assert held.data.metrics["b/c"] == 0.5 and np.isnan(held.data.metrics["bad"])
    table = json.loads(artifact(client, run.id, "tables/results.json").read_text())
    assert table == {
        "columns": ["method", "mse", "x"],
        "data": [["A", 0.5, None], [None, None, None]],
    }
    assert artifact(client, run.id, "figures/empty.png").read_bytes().startswith(b"\x89PNG")
    assert artifact(client, run.id, "config.yaml").read_text() == "a: 1\n"
    assert artifact(client, run.id, "files/notes.txt").read_text() == "notes"
    store = Path(uri.removeprefix("sqlite:///")).parent
    assert artifact(client, run.id, "config.yaml").is_relative_to(store / "mlartifacts" / "toy")


def test_a_table_is_what_mlflows_own_would_be(uri: str, client: MlflowClient) -> None:
    rows = [{"method": "A", "mse": 0.5, "n": 3}, {"method": "B", "mse": 0.25, "n": 4}]
    with track.run("toy", "ours", uri=uri) as ours, track.run("toy", "theirs", uri=uri) as theirs:
        ours.table("tables/t", rows)
        columns = {key: [row[key] for row in rows] for key in rows[0]}
        client.log_table(theirs.id, columns, "tables/t.json")

    def read(run_id: str) -> tuple[object, object]:
        told = json.loads(client.get_run(run_id).data.tags["mlflow.loggedArtifacts"])
        return told, json.loads(artifact(client, run_id, "tables/t.json").read_text())

    assert read(ours.id) == read(theirs.id)


@pytest.mark.parametrize(
    ("error", "status"),
    [(KeyboardInterrupt(), "KILLED"), (RuntimeError("collapsed"), "FAILED")],
)
def test_an_interrupted_run_keeps_its_metrics_says_so_and_resumes(
    uri: str, client: MlflowClient, error: BaseException, status: str
) -> None:
    with pytest.raises(type(error)), track.run("toy", "cut", uri=uri) as run:
        run.params({"lr": 0.1})
        run.table("t", [{"x": 1}])
        run.metrics({"loss": 3.0}, 7)
        raise error
    assert client.get_run(run.id).info.status == status
    assert client.get_metric_history(run.id, "loss")[0].step == 7

    with track.run("toy", "cut", uri=uri, run_id=run.id) as again:
        assert again.id == run.id
        assert client.get_run(run.id).info.status == "RUNNING"
        again.params({"lr": 0.1, "new": 1})
        again.table("t", [{"x": 1}])
        again.metrics({"loss": 2.0}, 8)
        with pytest.raises(ConfigError, match=r"lr is 0.2 now and was 0.1.*same configuration"):
            again.params({"lr": 0.2})
    held = client.get_run(run.id)
    assert held.info.status == "FINISHED" and held.data.params == {"lr": "0.1", "new": "1"}
    assert [m.step for m in client.get_metric_history(run.id, "loss")] == [7, 8]
    assert json.loads(artifact(client, run.id, "t.json").read_text())["data"] == [[1]]


def test_a_run_that_is_not_there_cannot_be_resumed(uri: str) -> None:
    with (
        pytest.raises(ConfigError, match=r"'0123' is not in sqlite.*begin a new run"),
        track.run("toy", "x", uri=uri, run_id="0123"),
    ):
        pytest.fail("resumed a run that never was")


def test_a_store_that_fails_is_one_line(uri: str, tmp_path: Path) -> None:
    (tmp_path / "junk.db").write_bytes(b"junk" * 999)
    with (
        pytest.raises(WorkError) as caught,
        track.run("x", "x", uri=f"sqlite:///{tmp_path}/junk.db"),
    ):
        pass
    assert "\n" not in str(caught.value)
    with pytest.raises(WorkError, match="failed"), track.run("toy", "x", uri=uri) as run:
        run.params({"no!such?name": 1})


def git(folder: Path, *arguments: str) -> str:
    who = ("-c", "user.name=T", "-c", "user.email=t@example.org")
    done = subprocess.run(
        ["git", *who, *arguments], cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which the package pretends to lie."""
    (tmp_path / "wt").mkdir()
    shutil.copy(str(track.__file__), tmp_path / "wt" / "track.py")
    monkeypatch.setattr(track, "__file__", str(tmp_path / "wt" / "track.py"))
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    return tmp_path


def test_commit_and_diff_are_gits(checkout: Path, uri: str, client: MlflowClient) -> None:
    assert track.source() == track.Source("unknown", "")  # outside git
    git(checkout, "init", "-q")
    assert track.source() == track.Source("unknown", "")  # in a repository that is not ours
    (checkout / "conf.yaml").write_text("a: 1\n")
    git(checkout, "add", ".")
    assert track.source() == track.Source("unknown", "")  # no commit yet
    git(checkout, "commit", "-qm", "first")
    assert track.source() == track.Source(git(checkout, "rev-parse", "HEAD"), "")
    (checkout / "conf.yaml").write_text("a: 2\n")
    with track.run("toy", "dirty", uri=uri) as run:
        pass
    assert client.get_run(run.id).data.tags["commit"] == git(checkout, "rev-parse", "HEAD")
    patch = artifact(client, run.id, "diff.patch").read_text()
    git(checkout, "checkout", "-q", "conf.yaml")
    (checkout / "got.patch").write_text(patch)
    git(checkout, "apply", "got.patch")  # git itself takes it
    assert (checkout / "conf.yaml").read_text() == "a: 2\n"


def test_works_without_git(
    uri: str, client: MlflowClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with track.run("toy", "no git", uri=uri) as run:
        pass
    assert client.get_run(run.id).data.tags["commit"] == "unknown"


def test_logging_a_metric_costs_training_little(uri: str) -> None:
    steps, names = 500, [f"loss/{i}" for i in range(20)]
    with track.run("toy", "cost", uri=uri) as run:
        start = time.process_time()
        for step in range(steps):
            run.metrics(dict.fromkeys(names, 0.5), step)
        run.flush()
        per_step = (time.process_time() - start) / steps
    # Measured: 2 ms for 20 metrics, all writing included; one by one it was 110 ms.
    assert per_step < 0.02


def test_mlflow_is_imported_only_when_a_run_begins() -> None:
    code = "import sys, wt.run.track; print([m for m in ('mlflow', 'torch') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.stdout.strip() == "[]"


def test_a_run_has_runs_below_it_that_are_found_again(uri: str, client: MlflowClient) -> None:
    with track.run("toy", "parent", uri=uri) as run:
        run.tags({"task": "toy", "mlflow.note.content": "words"})
        run.child("A, seed 0").metrics({"loss": 1.0}, 0)
        run.child("B, seed 0").params({"seed": 0})
    with track.run("toy", "parent", uri=uri, run_id=run.id) as again:
        again.child("A, seed 0").metrics({"loss": 0.5}, 1)
    held = client.get_run(run.id)
    below = client.search_runs([held.info.experiment_id], f"tags.`mlflow.parentRunId` = '{run.id}'")
    by_name = {r.info.run_name: r for r in below}
    assert set(by_name) == {"A, seed 0", "B, seed 0"}
    assert {r.info.status for r in below} == {"FINISHED"}
    assert by_name["B, seed 0"].data.params == {"seed": "0"}
    assert by_name["A, seed 0"].data.tags["task"] == "toy"
    history = client.get_metric_history(by_name["A, seed 0"].info.run_id, "loss")
    assert [(m.step, m.value) for m in history] == [(0, 1.0), (1, 0.5)]
    assert {"mlflow.source.name", "mlflow.user", "mlflow.note.content"} <= set(held.data.tags)


def test_a_run_that_has_ended_keeps_its_status_and_duration(uri: str, client: MlflowClient) -> None:
    with pytest.raises(ZeroDivisionError), track.run("toy", "parent", uri=uri) as run:
        run.child("A").end("FINISHED")
        ended = client.get_run(run.child("A").id).info.end_time
        run.child("A").metrics({"loss": 1.0}, 0)
        _ = 1 / 0
    with track.run("toy", "parent", uri=uri, run_id=run.id) as again:
        again.child("A").metrics({"loss": 0.5}, 1)
    held = client.get_run(run.child("A").id)
    assert (held.info.status, held.info.end_time) == ("FINISHED", ended)
    assert held.data.metrics == {"loss": 0.5}


def test_what_fails_fails_with_all_below_it(uri: str, client: MlflowClient) -> None:
    with pytest.raises(ZeroDivisionError), track.run("toy", "cut", uri=uri) as run:
        child = run.child("A")
        child.metrics({"loss": 2.0}, 0)
        _ = 1 / 0
    assert client.get_run(child.id).info.status == "FAILED"
    assert client.get_run(child.id).data.metrics == {"loss": 2.0}


def test_data_is_shown_with_its_digest(uri: str, client: MlflowClient, tmp_path: Path) -> None:
    from mlflow.data import get_source
    from mlflow.types import Schema

    columns = ("o/qpos/hip", "a/u")
    data = track.Dataset("toy/real", "training", "0123456789abcdef", tmp_path, 300, columns)
    with track.run("toy", "data", uri=uri) as run:
        run.inputs([data])
        run.inputs([data])
    (used,) = client.get_run(run.id).inputs.dataset_inputs
    assert (used.dataset.name, used.dataset.digest) == ("toy/real", "0123456789abcdef")
    assert {t.key: t.value for t in used.tags} == {"mlflow.data.context": "training"}
    assert json.loads(used.dataset.profile) == {"num_rows": 300}
    schema = Schema.from_json(json.dumps(json.loads(used.dataset.schema)["mlflow_colspec"]))
    assert schema.input_names() == ["o/qpos/hip", "a/u"]
    assert Path(get_source(used).load()) == tmp_path


def test_the_machine_is_watched(
    uri: str, client: MlflowClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL", "0.1")
    with track.run("toy", "watched", uri=uri) as run, track.machine(run):
        time.sleep(1.0)
    seen = client.get_run(run.id).data.metrics
    assert 0 <= seen["system/cpu_utilization_percentage"] <= 100
    assert seen["system/system_memory_usage_megabytes"] > 0
