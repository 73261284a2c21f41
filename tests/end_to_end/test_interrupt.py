"""A run that is interrupted, killed and resumed ends like one that nothing disturbed."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.end_to_end.conftest import METHODS, Place, Started, Wt
from wt.config import load
from wt.errors import WorkError
from wt.run.jobs import Job, run_jobs
from wt.run.study import Study

TRAINED = ("WorldTranslation", "WorldTranslationPlus")

Start = Callable[..., Started]

pytestmark = pytest.mark.usefixtures("proc")


def in_training(folder: Path, since: float = 0.0) -> Callable[[], bool]:
    """Whether a model has a checkpoint newer than ``since`` but is not finished."""
    work = folder / "work" / "seed0"

    def one(method: str) -> bool:
        try:
            newest = (work / method / "last.ckpt").stat().st_mtime
        except FileNotFoundError:
            return False
        return newest > since and not (work / method / "model.pt").exists()

    return lambda: any(one(method) for method in TRAINED)


def last_checkpoint(folder: Path) -> float:
    return max(p.stat().st_mtime for p in folder.rglob("last.ckpt"))


def status(place: Place, folder: Path) -> str:
    from mlflow import MlflowClient

    client = MlflowClient(tracking_uri=place.store)
    return client.get_run((folder / "mlflow_run_id").read_text()).info.status


def comparable(folder: Path) -> dict[str, Any]:
    """The results without the number that the registry gave."""
    content = json.loads((folder / "results.json").read_text())
    del content["version"]
    return content


def assert_one_line(ended: tuple[int, str, str], folder: str) -> None:
    code, out, err = ended
    assert (code, out) == (1, "")
    said = [line for line in err.splitlines() if " % after " not in line]  # but for progress
    assert said == [
        "error: interrupted: nothing finished is lost; continue with: "
        f"wt fit --config {folder}/config.yaml --resume --out {folder}"
    ]


@pytest.mark.long
def test_a_kill_then_resume_change_nothing(
    start: Start, place: Place, finished: Path, wt: Wt
) -> None:
    folder = place.home / "disturbed"
    run = start(*place.words, "workers=2", "--out", "disturbed")
    run.wait_until(in_training(folder))
    assert len(run.others()) >= 2  # its workers
    killed_then_resumed(run, folder, finished, wt)
    assert status(place, folder) == "FINISHED"
    # the run that nothing disturbed had one worker: their number changes nothing either
    assert load(folder / "config.yaml").workers == 2


@pytest.mark.long
def test_ctrl_c_then_a_kill_then_resume_change_nothing(
    start: Start, place: Place, finished: Path, wt: Wt
) -> None:
    folder = place.home / "interrupted"
    run = start(*place.words, "workers=2", "--out", "interrupted")
    run.wait_until(in_training(folder))
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does it: to parent and workers
    assert_one_line(run.end(), "interrupted")
    assert run.left_alone()
    assert status(place, folder) == "KILLED"
    before = last_checkpoint(folder)
    run = start(*again("interrupted"))
    run.wait_until(in_training(folder, since=before))
    killed_then_resumed(run, folder, finished, wt, since=before)
    assert status(place, folder) == "FINISHED"


def again(name: str) -> list[str]:
    """Arguments that continue a run."""
    return ["--config", f"{name}/config.yaml", "--resume", "--out", name]


def killed_then_resumed(
    run: Started, folder: Path, finished: Path, wt: Wt, since: float = 0.0
) -> None:
    """Kill a run in training, see that its workers end too, and finish it."""
    os.kill(run.pid, signal.SIGKILL)
    assert run.end()[0] == -signal.SIGKILL
    assert run.left_alone()
    # its workers ended with it: had they trained on, they would be in the next run's way
    assert in_training(folder, since=since)()
    code, out, err = wt("fit", *again(folder.name))
    assert (code, [x for x in err.splitlines() if " % after " not in x]) == (0, [])
    assert "WorldTranslationPlus" in out
    assert_same(folder, finished)


def assert_same(folder: Path, other: Path) -> None:
    assert (folder / "model.onnx").read_bytes() == (other / "model.onnx").read_bytes()
    for method in METHODS:
        one, two = (np.load(f / "work" / "seed0" / f"{method}.npy") for f in (folder, other))
        np.testing.assert_array_equal(one, two, err_msg=method)
    for method in TRAINED:
        files = [f / "work" / "seed0" / method / "model.pt" for f in (folder, other)]
        one, two = (torch.load(file, weights_only=True) for file in files)
        assert one.keys() == two.keys()
        assert all(torch.equal(one[key], two[key]) for key in one), method
    assert comparable(folder) == comparable(other)


def test_ctrl_c_with_a_single_worker(start: Start, place: Place, finished: Path) -> None:
    run = start(*place.words, "workers=1", "--out", "single")
    run.wait_until(in_training(place.home / "single"))
    os.kill(run.pid, signal.SIGINT)
    assert_one_line(run.end(), "single")
    assert status(place, place.home / "single") == "KILLED"
    assert list((place.home / "single").rglob("last.ckpt"))


@contextmanager
def killer() -> Iterator[None]:
    """Kills the first worker that comes up, as a system does that runs out of memory."""

    def kill() -> None:
        while not (workers := multiprocessing.active_children()):
            time.sleep(0.05)
        workers[0].kill()

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    yield
    thread.join()


def test_a_worker_that_is_killed_ends_the_run(place: Place, finished: Path, tmp_path: Path) -> None:
    config = load(place.words[1], [*place.words[2:], "workers=2"])
    study = Study.open(config, tmp_path)
    with pytest.raises(WorkError, match=r"was killed .* --resume"), killer():
        run_jobs(study, [Job(0, method) for method in TRAINED])
    assert multiprocessing.active_children() == []


@pytest.mark.long
def test_a_worker_that_is_killed_while_the_next_one_starts_ends_the_run(
    place: Place, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pool closes the pipes that the next one is to inherit."""
    start = ProcessPoolExecutor._spawn_process

    def start_late(pool: ProcessPoolExecutor) -> None:
        for worker in multiprocessing.active_children():
            worker.kill()
            time.sleep(2.0)
        start(pool)

    monkeypatch.setattr(ProcessPoolExecutor, "_spawn_process", start_late)
    config = load(place.words[1], [*place.words[2:], "workers=2"])
    study = Study.open(config, tmp_path)
    with pytest.raises(WorkError, match=r"was killed .* --resume"):
        run_jobs(study, [Job(0, method) for method in TRAINED])
    assert multiprocessing.active_children() == []
