"""Everything once more through a real MLflow server on the loopback interface."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import requests

from registry.pull import pull
from registry.push import push
from wt.errors import RegistryError
from wt.run import track

START_SECONDS = 90


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, _empty_store: Path) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("server")
    (folder / "mlflow.db").write_bytes(_empty_store.read_bytes())
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1"]
    command += ["--port", str(port), "--workers", "1"]
    command += ["--backend-store-uri", f"sqlite:///{folder}/mlflow.db"]
    command += ["--artifacts-destination", str(folder / "kept")]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            command, cwd=folder, stdout=log, stderr=log, start_new_session=True
        )
    uri = f"http://127.0.0.1:{port}"
    try:
        for _ in range(START_SECONDS * 5):
            if process.poll() is not None:
                break
            try:
                if requests.get(f"{uri}/health", timeout=1).ok:
                    break
            except requests.RequestException:
                time.sleep(0.2)
        else:
            pytest.fail(f"no server after {START_SECONDS} s: {(folder / 'log').read_text()}")
        assert process.poll() is None, (folder / "log").read_text()
        yield uri
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(20)


@pytest.mark.long
def test_a_run_its_model_and_a_changed_byte(
    server: str,
    make_folder: Callable[..., Path],
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", server)  # as a user would choose it
    folder = make_folder(value=0.5)
    with track.run("toy", "through a server") as run:
        run.params({"train.lr": 1e-3})
        for step in range(3):
            run.metrics({"loss": 1.0 / (step + 1)}, step)
        run.table("results", [{"method": "RawSim", "mse": 1.0}])
        run.text("a: 1\n", "config.yaml")
        pushed = push("wt-toy", folder, 0.5, run.id)
    assert pushed.aliases == ("champion",)

    # What the server holds, asked over its REST interface and not by our code.
    api = f"{server}/api/2.0/mlflow"
    told = requests.get(f"{api}/runs/get", {"run_id": run.id}, timeout=10).json()["run"]
    assert told["info"]["status"] == "FINISHED"
    assert {p["key"]: p["value"] for p in told["data"]["params"]} == {"train.lr": "0.001"}
    history = requests.get(
        f"{api}/metrics/get-history", {"run_id": run.id, "metric_key": "loss"}, timeout=10
    ).json()["metrics"]
    assert [(m["step"], m["value"]) for m in history] == [(0, 1.0), (1, 0.5), (2, 1 / 3)]
    files = requests.get(f"{api}/artifacts/list", {"run_id": run.id}, timeout=10).json()["files"]
    assert {"results.json", "config.yaml"} <= {f["path"] for f in files}
    champion = requests.get(
        f"{api}/registered-models/alias", {"name": "wt-toy", "alias": "champion"}, timeout=10
    ).json()["model_version"]
    assert champion["version"] in (1, "1") and champion["run_id"] == run.id

    pull("wt-toy@champion", tmp_path / "pulled")
    for file in ("model.onnx", "card.json"):
        assert (tmp_path / "pulled" / file).read_bytes() == (folder / file).read_bytes()
    import mlflow.pyfunc

    mlflow.set_tracking_uri(server)
    model = mlflow.pyfunc.load_model("models:/wt-toy@champion")
    assert model.predict(model.input_example).shape == (5, 3)
    assert not (tmp_path / "mlflow.db").exists() and not (tmp_path / "mlruns").exists()

    (kept,) = tmp_path_factory.getbasetemp().glob("server[0-9]*/kept/**/model.onnx")
    content = bytearray(kept.read_bytes())
    content[-1] ^= 1
    kept.write_bytes(content)
    with pytest.raises(RegistryError, match=r"model\.onnx of wt-toy/1 .* bytes were changed"):
        pull("wt-toy@champion", tmp_path / "again")
    kept.unlink()
    with pytest.raises(RegistryError, match=r"cannot give its model\.onnx"):
        pull("wt-toy@champion", tmp_path / "again")
    assert not (tmp_path / "again").exists()
