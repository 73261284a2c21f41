"""Bad input ends with one clear line and the right exit code, and earlier outputs stay."""

from __future__ import annotations

import hashlib
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.conftest import Place, Wt
from wt.config import load
from wt.run.jobs import Job, run_jobs
from wt.run.study import Study
from wt.show.files import kept


def hashes(folder: Path) -> dict[str, str]:
    """Content of every file below a folder."""
    files = (p for p in folder.rglob("*") if p.is_file())
    return {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def assert_refused(ended: tuple[int, str, str], code: int, *said: str) -> None:
    assert ended[:2] == (code, ""), ended
    *before, last = ended[2].splitlines()
    assert last.startswith("error: "), ended[2]
    # on a busy machine there is progress before it, and nothing else
    assert all(re.fullmatch(r".+: \d+ % after \d+ s", line) for line in before), ended[2]
    for part in said:
        assert part in ended[2]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("plus.train.stepz=3", ("unknown key 'plus.train.stepz'", "did you mean 'steps'?")),
        ("wrld.name=r5", ("unknown key 'wrld'", "did you mean 'world'?")),
        ("world.force.max_newtn=3", ("'world.force.max_newtn'", "did you mean 'max_newton'?")),
        ("data.transitions=many", ("data.transitions", "many")),
        ("seeds=[a]", ("seeds", "'a'")),
        ("seeds=[]", ("seeds []",)),
        ("plus.translation.adversarial=wgan", ("plus.translation.adversarial", "lsgan")),
        ("paper.train.batch=0", ("paper.train.batch is 0", "above zero")),
        ("world.name=r6", ("world.name 'r6' is not known", "allowed: r5, so101")),
        ("world.timestep=0.003", ("world.timestep 0.003 s does not divide",)),
        ("baselines.names=[RawSim,ResDin]", ("'ResDin'", "did you mean 'ResDyn'?")),
        ("registry_name=team/r5", ("registry_name: 'team/r5' is no model name; use letters",)),
        ("registry_name='r5:best'", ("registry_name: 'r5:best'", "e.g. wt-r5")),
        ("registry_name=..", ("registry_name: '..'",)),
        ("registry_name=''", ("registry_name: ''",)),
        ("nonsense", ("'nonsense' is not of the form key=value",)),
    ],
)
def test_a_wrong_configuration_leaves_nothing_behind(
    wt: Wt, place: Place, word: str, said: tuple[str, ...]
) -> None:
    assert_refused(wt("fit", *place.words, word, "--out", "refused"), 2, *said)
    assert not (place.home / "refused").exists()


def test_a_missing_configuration_names_its_neighbour(wt: Wt, place: Place) -> None:
    missing = place.conf / "debgu.yaml"
    assert_refused(
        wt("fit", "--config", missing), 2, "debgu.yaml' does not exist", "did you mean 'debug.yaml'"
    )


def test_resume_needs_the_folder_of_a_run(wt: Wt, place: Place, tmp_path: Path) -> None:
    assert_refused(wt("fit", *place.words, "--resume"), 2, "--resume needs --out")
    empty = ("fit", *place.words, "--resume", "--out", tmp_path)
    assert_refused(wt(*empty), 2, f"{tmp_path} holds no run")
    assert list(tmp_path.iterdir()) == []


def test_a_finished_run_is_not_overwritten(wt: Wt, place: Place, finished: Path) -> None:
    before = hashes(finished)
    run = ("fit", *place.words, "workers=1", "--out", finished)
    assert_refused(wt(*run), 2, "already holds a run", "--resume")
    assert_refused(
        wt(*run, "plus.vae.beta=0.5", "--resume"), 2, "configuration differs", "no overrides"
    )
    out = finished / "results.json"
    assert_refused(wt("fit", *place.words, "--out", out), 2, "is a file")
    assert hashes(finished) == before


def test_a_folder_that_another_run_writes_into_is_left_alone(
    wt: Wt, place: Place, tmp_path: Path
) -> None:
    with kept(tmp_path / "run"):
        ended = wt("fit", *place.words, "--out", tmp_path / "run")
        assert_refused(ended, 1, "is being written by another wt process")
        assert not list((tmp_path / "run").iterdir())


def test_a_truncated_collection(wt: Wt, place: Place, finished: Path) -> None:
    (part,) = place.data.glob("r5_force-real-*/part-000.parquet")
    whole = part.read_bytes()
    before = hashes(finished)
    part.write_bytes(whole[: len(whole) // 2])
    try:
        ended = wt("fit", *place.words, "--out", "truncated")
        assert_refused(ended, 2, str(part), "cannot be read", "delete it and run again")
    finally:
        part.write_bytes(whole)
    assert hashes(finished) == before


def test_missing_recordings(wt: Wt, place: Place, finished: Path) -> None:
    ended = wt(
        "fit", "--config", place.conf / "so101.yaml", "world.recordings=/nowhere",
        f"data.dir={place.data}", "--out", "no-recordings",
    )  # fmt: skip
    assert_refused(ended, 2, "world.recordings '/nowhere' does not exist")


def test_a_registered_model_whose_bytes_were_changed(
    wt: Wt, place: Place, finished: Path, tmp_path: Path
) -> None:
    (folder,) = {
        path.parent
        for path in place.home.glob("mlartifacts/**/model.onnx")
        if path.with_name("card.json").read_bytes() == (finished / "card.json").read_bytes()
    }
    whole = (folder / "model.onnx").read_bytes()
    (folder / "model.onnx").write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    try:
        ended = wt("registry", "pull", "wt-debug/1", "--to", tmp_path / "pulled")
        assert_refused(ended, 2, "model.onnx of wt-debug/1", "bytes were changed")
    finally:
        (folder / "model.onnx").write_bytes(whole)
    assert list(tmp_path.iterdir()) == []


def test_a_server_that_does_not_answer(
    wt: Wt, place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:1")
    ended = wt("fit", *place.words, "--out", "no-server")
    assert_refused(ended, 1, "no MLflow server answers at http://127.0.0.1:1", "start it")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1.5 MB: room for two checkpoints, not for a run."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1500k", "none", str(folder)]
    try:
        subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", None) or error
        pytest.skip(f"{' '.join(command)}: {str(why).strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk(wt: Wt, place: Place, finished: Path, small_disk: Path) -> None:
    before = hashes(finished) | hashes(place.data)
    ended = wt("fit", *place.words, "workers=1", "--out", small_disk / "run")
    assert_refused(ended, 1, "the disk is full; earlier outputs are intact", "free some space")
    assert hashes(finished) | hashes(place.data) == before
    assert not (small_disk / "run" / "results.json").exists()


def test_a_full_disk_then_room_again(
    wt: Wt, place: Place, finished: Path, small_disk: Path
) -> None:
    folder = small_disk / "run"
    assert wt("fit", *place.words, "workers=1", "--out", folder)[0] == 1
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    study = Study.open(load(folder / "config.yaml"), folder)
    run_jobs(study, [Job(0, "WorldTranslationPlus")])
    expected = np.load(finished / "work" / "seed0" / "WorldTranslationPlus.npy")
    np.testing.assert_array_equal(study.prediction(0, "WorldTranslationPlus"), expected)
