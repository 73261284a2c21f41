"""Walking policies in the registry: pushed, pulled, compared, refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from mlflow import MlflowClient

from deploy.policies import load
from registry.policies import pull, push
from registry.pull import pull as pull_model
from registry.push import push as push_model
from tests.registry.conftest import MakeFolder
from wt.cli.main import main
from wt.errors import RegistryError
from wt.worlds.policy import CARD, GRAPH, SHIPPED


def copied(folder: Path, factor: float = 1.0, **changes: object) -> Path:
    """The shipped Go2 policy, with tracking errors times a factor and other changes of the card."""
    shutil.copytree(SHIPPED / "go2", folder)
    card = json.loads((folder / CARD).read_text())
    for trial in card["evaluation"]["tracking"]:
        trial["error"] *= factor
    (folder / CARD).write_text(json.dumps({**card, **changes}))
    return folder


def test_what_is_pulled_is_what_was_pushed(store_uri: str, run_id: str, tmp_path: Path) -> None:
    folder = copied(tmp_path / "made")
    pushed = push(folder, run_id, uri=store_uri)
    assert (str(pushed), pushed.aliases) == ("go2/1", ("champion",))
    tags = MlflowClient(store_uri, store_uri).get_model_version("go2", "1").tags
    assert (tags["task"], tags["commit"]) == ("go2", "unknown")
    assert tags["robot"] == "go2" and tags["made_by"].startswith("wt-train-policy")
    errors = [
        trial["error"]
        for trial in json.loads((folder / CARD).read_text())["evaluation"]["tracking"]
    ]
    assert pushed.heldout.value == pytest.approx(sum(errors) / 6)
    assert pull("go2@champion", tmp_path / "pulled", uri=store_uri) == pushed
    for file in (GRAPH, CARD):
        assert (tmp_path / "pulled" / file).read_bytes() == (folder / file).read_bytes()
    assert push(folder, run_id, uri=store_uri) == pushed  # not twice


def test_champion_is_who_follows_commands_best_in_the_same_trials(
    store_uri: str, run_id: str, tmp_path: Path
) -> None:
    def champions(name: str, factor: float, **changes: object) -> tuple[str, ...]:
        return push(copied(tmp_path / name, factor, **changes), run_id, uri=store_uri).aliases

    assert champions("first", 1.0) == ("champion",)
    assert champions("worse", 1.1) == ()
    assert champions("better", 0.9) == ("champion",)
    elsewhere = {"scene": {"payload": None, "blocks": {"height": 0.05}}, "physics": None}
    assert champions("elsewhere", 0.1, config=elsewhere) == ()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sha256": "0" * 64}, "its card says 000000000000"),
        ({"evaluation": {}}, "has no evaluation"),
        ({"name": "a/b"}, "no model name"),
    ],
)
def test_a_policy_that_nobody_can_vouch_for_is_refused(
    store_uri: str, run_id: str, tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    with pytest.raises(RegistryError, match=said):
        push(copied(tmp_path / "odd", **changes), run_id, uri=store_uri)


@pytest.mark.parametrize(("file", "said"), [(GRAPH, "has no policy.onnx"), (CARD, "has no card")])
def test_a_missing_file_is_named(
    store_uri: str, run_id: str, tmp_path: Path, file: str, said: str
) -> None:
    folder = copied(tmp_path / "half")
    (folder / file).unlink()
    with pytest.raises(RegistryError, match=said):
        push(folder, run_id, uri=store_uri)


@pytest.mark.parametrize("file", [GRAPH, CARD])
def test_a_changed_byte_is_never_pulled(
    store_uri: str, run_id: str, tmp_path: Path, file: str
) -> None:
    push(copied(tmp_path / "made"), run_id, uri=store_uri)
    (stored,) = (tmp_path / "store" / "mlartifacts").rglob(file)
    stored.write_bytes(stored.read_bytes().replace(b"e", b"f", 1))
    with pytest.raises(RegistryError, match=f"{file} of go2/1 has sha256"):
        pull("go2@champion", tmp_path / "pulled", uri=store_uri)
    assert not (tmp_path / "pulled").exists()


def test_models_and_policies_are_told_apart(
    store_uri: str, run_id: str, tmp_path: Path, make_folder: MakeFolder
) -> None:
    push(copied(tmp_path / "made"), run_id, uri=store_uri)
    push_model("wt-toy", make_folder(value=0.5), 0.5, run_id, uri=store_uri)
    with pytest.raises(RegistryError, match="is no walking policy"):
        pull("wt-toy/1", tmp_path / "out", uri=store_uri)
    with pytest.raises(RegistryError, match="is a walking policy"):
        pull_model("go2/1", tmp_path / "out", uri=store_uri)


def test_from_the_command_line(
    store_uri: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store_uri)
    monkeypatch.chdir(tmp_path)
    assert main(["registry", "push", "go2"]) == 0
    assert main(["registry", "pull", "go2@champion"]) == 0
    out = capsys.readouterr().out
    assert "go2/1: champion: the first one" in out and "go2-1: go2/1, sha256" in out
    assert (tmp_path / "go2-1" / GRAPH).read_bytes() == (SHIPPED / "go2" / GRAPH).read_bytes()
    assert main(["registry", "push", "nowhere"]) == 2
    assert "'nowhere' does not exist" in capsys.readouterr().err
    assert main(["registry", "show", "go2@champion"]) == 2
    assert "is a walking policy" in capsys.readouterr().err


def test_a_robot_runs_what_is_registered(
    store_uri: str, run_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store_uri)
    monkeypatch.chdir(tmp_path)
    pushed = push(copied(tmp_path / "made"), run_id, uri=store_uri)
    for reference in ("go2@champion", "go2/1"):
        assert load(reference).card.sha256 == pushed.sha256
    with pytest.raises(RegistryError, match="no alias 'nobody'"):
        load("go2@nobody")
