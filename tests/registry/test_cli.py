"""``wt registry`` as a user types it: output, one-line errors, exit codes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from registry.push import push
from wt.cli import main as cli

MakeFolder = Callable[..., Path]


@pytest.fixture
def store(
    store_uri: str,
    run_id: str,
    make_folder: MakeFolder,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Path:
    """Folder of a store with two versions, the second one better; named as a user would."""
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store_uri)
    monkeypatch.setenv("COLUMNS", "200")
    for name in cli.QUIET:  # so that what main sets is undone
        monkeypatch.setenv(name, "1")
    monkeypatch.chdir(tmp_path)
    for value in (0.5, 0.25):
        push("wt-toy", make_folder(value), value, run_id)
    return tmp_path / "store"


def wt(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.main(["registry", *arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_list_shows_versions_aliases_and_metrics(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = wt(capsys, "list")
    _, first, second = out.splitlines()
    assert (code, err) == (0, "")
    assert first.split()[:3] == ["wt-toy/1", "mse", "0.5"]
    assert second.split()[:4] == ["wt-toy/2", "champion", "mse", "0.25"]
    assert wt(capsys, "list", "wt-toy")[1] == out


def test_show_prints_the_card(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = wt(capsys, "show", "wt-toy@champion")
    assert (code, err) == (0, "")
    for words in (
        ("wt-toy/2", "@champion", "50 Hz", "hip, knee", "qpos/hip [rad]", "v [rad/s]"),
        ("mse 0.25 on pairs/test", "batch x 3", "mse_change", "1.0e-07", "0" * 40),
    ):
        for word in words:
            assert word in out


def test_show_prints_the_card_of_a_policy_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = wt(capsys, "show", "go2")
    assert code == 0 and "wt model go2 > go2.xml" in out and "FL_hip_joint" in out, err
    assert not list(tmp_path.iterdir())


def test_promote_moves_the_alias_and_pull_follows_it(
    store: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert wt(capsys, "promote", "wt-toy/1")[:2] == (0, "wt-toy@champion is now wt-toy/1\n")
    assert wt(capsys, "promote", "wt-toy/2", "--alias", "best")[0] == 0
    code, out, err = wt(capsys, "pull", "wt-toy@champion", "--to", "here")
    assert code == 0 and out.startswith("here: wt-toy/1, sha256 ") and err == ""
    assert (tmp_path / "here/card.json").read_bytes() == (
        tmp_path / "model-0/card.json"
    ).read_bytes()
    assert wt(capsys, "pull", "wt-toy@best")[0] == 0
    assert (tmp_path / "wt-toy-2" / "model.onnx").is_file()


def test_bad_input_is_one_line_and_exit_code_2(
    store: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    for arguments, said in (
        (["pull", "wt-toy@nobody"], "no alias 'nobody'"),
        (["pull", "wt-toy/9"], "no version 9"),
        (["pull", "wt-toy/1", "--to", "file"], "file is a file"),
        (["show", "wt-toi/1"], "did you mean 'wt-toy'"),
        (["list", "wt-toi"], "did you mean 'wt-toy'"),
        (["promote", "wt-toy/1", "--alias", "latest"], "'latest' is no alias"),
        (["promote", "wt-toy/1", "--alias", "v2"], "'v2' is no alias"),
        (["promote", "wt-toy"], "NAME/VERSION"),
    ):
        code, out, err = wt(capsys, *arguments)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert said in err
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    code, out, err = wt(capsys, "list")
    assert (code, out, err.count("\n")) == (2, "", 1) and "no model store at" in err
    assert not (tmp_path / "mlflow.db").exists()


def test_a_changed_byte_is_one_line_and_exit_code_2(
    store: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for path in store.rglob("model.onnx"):
        content = bytearray(path.read_bytes())
        content[100] ^= 8
        path.write_bytes(content)
    code, out, err = wt(capsys, "pull", "wt-toy@champion", "--to", "here")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("error: model.onnx of wt-toy/2") and "bytes were changed" in err
    assert not (tmp_path / "here").exists()
