"""A registered version as a stranger loads it: with MLflow alone, and nothing of ours."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from registry.push import push
from wt.worlds.policy import SHIPPED

MakeFolder = Callable[..., Path]
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]

STRANGER = """
import sys
import mlflow, pandas as pd
mlflow.set_tracking_uri(sys.argv[1])
model = mlflow.pyfunc.load_model("models:/wt-toy@champion")
model.predict(pd.read_json(sys.argv[2], orient="split")).to_json(sys.argv[3], orient="split")
assert not [name for name in sys.modules if name.split(".")[0] in ("wt", "registry")]
"""


@pytest.fixture
def loaded(store_uri: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    import mlflow

    monkeypatch.setenv("MLFLOW_TRACKING_URI", store_uri)
    before = mlflow.get_tracking_uri()
    mlflow.set_tracking_uri(store_uri)
    yield store_uri
    mlflow.set_tracking_uri(before)


def frame_of(rows: Rows) -> pd.DataFrame:
    columns = [f"{port}/{c}" for port, names in (
        ("o", ("qpos/hip", "qpos/knee", "v")), ("a", ("u1", "u2")),
        ("o_next_sim", ("qpos/hip", "qpos/knee", "v")),
    ) for c in names]  # fmt: skip
    return pd.DataFrame(np.hstack(rows), columns=columns)


def test_a_frame_is_translated_in_whatever_order_its_columns_are(
    loaded: str, make_folder: MakeFolder, run_id: str, rows: Rows,
    truth: Callable[..., np.ndarray],
) -> None:  # fmt: skip
    import mlflow

    push("wt-toy", make_folder(0.5), 0.5, run_id, uri=loaded)
    model = mlflow.pyfunc.load_model("models:/wt-toy@champion")
    frame = frame_of(rows)
    mixed = frame[frame.columns[::-1]].astype(np.float64).assign(unused=1.0)
    answer = model.predict(mixed)
    assert list(answer) == [f"o_next_real/{c}" for c in ("qpos/hip", "qpos/knee", "v")]
    np.testing.assert_allclose(answer.to_numpy(), truth(*rows), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        model.predict(model.input_example).to_numpy(), truth(*rows), rtol=1e-6, atol=1e-6
    )
    with pytest.raises(Exception, match="o/v"):
        model.predict(frame.drop(columns="o/v"))


def test_signature_requirements_and_the_words_on_it(
    loaded: str, make_folder: MakeFolder, run_id: str
) -> None:
    import mlflow
    from mlflow import MlflowClient

    push("wt-toy", make_folder(0.5), 0.5, run_id, uri=loaded)
    info = mlflow.models.get_model_info("models:/wt-toy@champion")
    assert info.signature.inputs.input_names()[:2] == ["o/qpos/hip", "o/qpos/knee"]
    assert set(info.flavors) == {"onnx", "python_function"} and info.run_id == run_id
    client = MlflowClient(tracking_uri=loaded)
    version = client.get_model_version_by_alias("wt-toy", "champion")
    assert version.tags["task"] == "toy" and version.tags["commit"] == "0" * 40
    assert "mse 0.5 on pairs/test" in version.description
    assert "task `toy`" in client.get_registered_model("wt-toy").description
    (output,) = client.get_run(run_id).outputs.model_outputs
    logged = client.get_logged_model(output.model_id)
    assert version.source == f"models:/{logged.model_id}"  # its page links to that model's
    files = client.get_model_version_download_uri("wt-toy", version.version)
    assert files == logged.artifact_location
    assert json.loads(logged.tags["mlflow.modelVersions"]) == [{"name": "wt-toy", "version": 1}]
    assert logged.tags["mlflow.note.content"] == version.description
    run = client.get_run(run_id)
    assert (
        logged.params == run.data.params
        and logged.tags.items()
        >= {key: run.data.tags[key] for key in ("mlflow.user", "mlflow.source.name")}.items()
    )
    (metric,) = logged.metrics
    assert (metric.key, metric.value, metric.run_id) == ("heldout/mse", 0.5, run_id)
    assert (metric.dataset_name, metric.dataset_digest) == ("pairs/test", "heldout-1")
    assert run.data.metrics["heldout/mse"] == 0.5
    pinned = mlflow.pyfunc.get_model_dependencies("models:/wt-toy@champion")
    lines = [line for line in Path(pinned).read_text().splitlines() if line]
    assert all("==" in line for line in lines)
    # what `mlflow models serve` makes an environment of
    conda = mlflow.pyfunc.get_model_dependencies("models:/wt-toy@champion", format="conda")
    (pip,) = (d["pip"] for d in json.loads(Path(conda).read_text())["dependencies"][2:])
    assert pip == lines


def test_a_process_without_our_code_can_run_it(
    loaded: str, make_folder: MakeFolder, run_id: str, rows: Rows, tmp_path: Path,
    truth: Callable[..., np.ndarray],
) -> None:  # fmt: skip
    push("wt-toy", make_folder(0.5), 0.5, run_id, uri=loaded)
    frame_of(rows).to_json(tmp_path / "frame.json", orient="split", double_precision=15)
    (tmp_path / "away").mkdir()
    command = [sys.executable, "-P", "-c", STRANGER, loaded, "../frame.json", "../answer.json"]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=tmp_path / "away", env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads((tmp_path / "answer.json").read_text())["data"]
    np.testing.assert_allclose(answer, truth(*rows), rtol=1e-6, atol=1e-6)


def test_mlflow_onnx_gives_the_graph_and_a_changed_one_is_not_run(
    loaded: str, make_folder: MakeFolder, run_id: str
) -> None:
    import mlflow.onnx

    folder = make_folder(0.5)
    push("wt-toy", folder, 0.5, run_id, uri=loaded)
    graph = mlflow.onnx.load_model("models:/wt-toy@champion")
    assert [i.name for i in graph.graph.input] == ["o", "a", "o_next_sim"]
    (stored,) = (Path(loaded.removeprefix("sqlite:///")).parent / "mlartifacts").rglob("model.onnx")
    content = bytearray(stored.read_bytes())
    content[-1] ^= 1
    stored.write_bytes(content)
    with pytest.raises(ValueError, match="not the graph that was registered"):
        mlflow.pyfunc.load_model("models:/wt-toy@champion")


def test_a_policy_is_one_too(loaded: str, run_id: str, tmp_path: Path) -> None:
    import mlflow.pyfunc

    from registry.policies import push as push_policy

    shutil.copytree(SHIPPED / "go2", tmp_path / "go2")
    push_policy(tmp_path / "go2", run_id, uri=loaded)
    model = mlflow.pyfunc.load_model("models:/go2@champion")
    answer = model.predict(model.input_example)
    assert answer.shape == (1, 12) and next(iter(answer)).startswith("action/FL")
    assert np.isfinite(answer.to_numpy()).all()
