"""Push, pull, aliases and damage, on a sqlite store; what MLflow holds is asked of MLflow."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from registry.backend import resolve_uri
from registry.card import HeldOut
from registry.pull import pull, read_card
from registry.push import compare, push
from registry.store import Store, Version
from wt.errors import RegistryError, WorkError
from wt.run import track

MakeFolder = Callable[..., Path]


def only(store_uri: str, name: str) -> Path:
    """The one stored file of that name."""
    root = Path(store_uri.removeprefix("sqlite:///")).parent / "mlartifacts"
    (path,) = root.rglob(name)
    return path


def test_push_then_pull_gives_the_same_bytes(
    make_folder: MakeFolder, store_uri: str, run_id: str, tmp_path: Path
) -> None:
    from mlflow import MlflowClient

    folder = make_folder(value=0.5)
    pushed = push("wt-toy", folder, 0.5, run_id, uri=store_uri)
    assert (str(pushed), pushed.aliases) == ("wt-toy/1", ("champion",))
    digest = hashlib.sha256((folder / "model.onnx").read_bytes()).hexdigest()
    held = MlflowClient(tracking_uri=store_uri).get_model_version_by_alias("wt-toy", "champion")
    assert (held.version, held.run_id, held.tags["sha256"]) == (1, run_id, digest)

    for reference in ("wt-toy@champion", "wt-toy/1"):
        to = tmp_path / "pulled" / "deep"
        version, card = pull(reference, to, uri=store_uri)
        assert version == pushed and card.sha256 == digest
        for file in ("model.onnx", "card.json"):
            assert (to / file).read_bytes() == (folder / file).read_bytes()
        assert sorted(os.listdir(to)) == ["card.json", "model.onnx"]
        assert os.listdir(to.parent) == ["deep"]
    assert read_card("wt-toy/1", uri=store_uri) == (version, card)


def test_champion_moves_only_to_a_better_model_on_the_same_data(
    make_folder: MakeFolder, store_uri: str, run_id: str
) -> None:
    def champion() -> int:
        return Store(store_uri).models()["wt-toy"]["champion"]

    for version, (value, data, holder, why) in enumerate(
        [
            (0.5, "heldout-1", 1, "the first one"),
            (0.6, "heldout-1", 1, "mse 0.6 >= 0.5 of wt-toy/1"),
            (0.5, "heldout-1", 1, "mse 0.5 >= 0.5"),
            (0.4, "heldout-1", 4, "mse 0.4 < 0.5 of wt-toy/1"),
            (0.1, "heldout-2", 4, "does not compare"),
            (0.3, "heldout-1", 6, "mse 0.3 < 0.4 of wt-toy/4"),
        ],
        start=1,
    ):
        # what the first run pushed once, another run may push too
        run = other_run(store_uri) if version == 3 else run_id
        pushed = push("wt-toy", make_folder(value, data), value, run, uri=store_uri)
        assert pushed.version == version
        assert champion() == holder
        assert why in pushed.decision
        assert pushed.decision.startswith("champion") == (holder == version)
    # One run pushed five: every version still has its own bytes.
    for v in Store(store_uri).versions("wt-toy"):
        assert read_card(str(v), uri=store_uri)[1].heldout == v.heldout


def other_run(store_uri: str) -> str:
    with track.run("toy", "another run", uri=store_uri) as run:
        return run.id


def test_a_run_registers_a_model_once(make_folder: MakeFolder, store_uri: str, run_id: str) -> None:
    first = push("wt-toy", make_folder(0.5), 0.5, run_id, uri=store_uri)
    card = only(store_uri, "card.json").read_bytes()

    again = make_folder(0.5)  # exported anew: the same model, its card of another second
    path = again / "card.json"
    path.write_text(re.sub(r'"created": "....', '"created": "2001', path.read_text()))
    assert path.read_bytes() != card
    assert push("wt-toy", again, 0.5, run_id, uri=store_uri) == first
    assert [v.version for v in Store(store_uri).versions("wt-toy")] == [1]
    assert path.read_bytes() == card

    # What was decided by hand in between stays.
    second = push("wt-toy", make_folder(0.6), 0.6, run_id, uri=store_uri)
    Store(store_uri).set_alias(second, "champion")
    assert push("wt-toy", again, 0.5, run_id, uri=store_uri).aliases == ()
    assert Store(store_uri).models()["wt-toy"] == {"champion": 2}


@pytest.mark.parametrize("late", [0.5, 0.3])
def test_a_push_that_was_killed_is_brought_to_its_end(
    make_folder: MakeFolder,
    store_uri: str,
    run_id: str,
    monkeypatch: pytest.MonkeyPatch,
    late: float,
) -> None:
    class Killed(BaseException):
        """Nothing catches it."""

    def killed(store: Store, version: Version, alias: str) -> None:
        raise Killed

    push("wt-toy", make_folder(0.6), 0.6, run_id, uri=store_uri)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(Store, "set_alias", killed)
        push("wt-toy", make_folder(0.4), 0.4, run_id, uri=store_uri)
    assert Store(store_uri).models()["wt-toy"] == {"champion": 1}
    push("wt-toy", make_folder(late), late, other_run(store_uri), uri=store_uri)
    pushed = push("wt-toy", make_folder(0.4), 0.4, run_id, uri=store_uri)
    assert pushed.version == 2
    # Who came in between keeps the alias only if nothing better is there.
    assert Store(store_uri).models()["wt-toy"] == {"champion": 2 if late > 0.4 else 3}
    assert [v.version for v in Store(store_uri).versions("wt-toy")] == [1, 2, 3]


@pytest.mark.parametrize("said", [None, "sqlite:///elsewhere.db"])
def test_a_push_leaves_the_store_of_the_process_as_it_was(
    make_folder: MakeFolder, store_uri: str, run_id: str, monkeypatch: pytest.MonkeyPatch,
    said: str | None,
) -> None:  # fmt: skip
    import mlflow

    if said:
        monkeypatch.setenv("MLFLOW_TRACKING_URI", said)
    before = mlflow.get_tracking_uri()
    push("wt-toy", make_folder(0.5), 0.5, run_id, uri=store_uri)
    assert os.environ.get("MLFLOW_TRACKING_URI") == said
    assert mlflow.get_tracking_uri() == before != store_uri


def test_another_metric_does_not_compare(
    make_folder: MakeFolder, store_uri: str, run_id: str
) -> None:
    version = push("wt-toy", make_folder(0.5), 0.5, run_id, uri=store_uri)
    wins, why = compare(HeldOut("pairs/test", "heldout-1", "mse_change", 0.1), version)
    assert not wins and "mse_change" in why


def test_push_refuses_what_was_not_checked(
    make_folder: MakeFolder, store_uri: str, run_id: str
) -> None:
    def refuse(folder: Path, metric: float, said: str, name: str = "wt-toy") -> None:
        with pytest.raises(RegistryError, match=said) as caught:
            push(name, folder, metric, run_id, uri=store_uri)
        assert caught.value.exit_code == 2 and "\n" not in str(caught.value)

    refuse(make_folder(parity=None), 0.5, "parity with the eager model is none")
    refuse(make_folder(parity=2e-5), 0.5, r"is 2.0e-05, at most 1e-05")
    refuse(make_folder(value=0.5), 0.4, "with mse 0.5, not of 'wt-toy' with 0.4")
    refuse(make_folder(), 0.5, "not of 'wt-other'", name="wt-other")
    truncated = make_folder()
    model = (truncated / "model.onnx").read_bytes()
    (truncated / "model.onnx").write_bytes(model[:-1])
    refuse(truncated, 0.5, "bytes were changed")
    assert Store(store_uri).models() == {}


@pytest.mark.parametrize("file", ["model.onnx", "card.json"])
@pytest.mark.parametrize("damage", ["byte", "truncated", "gone"])
def test_damage_in_the_store_is_found_and_nothing_lands(
    make_folder: MakeFolder, store_uri: str, run_id: str, tmp_path: Path, file: str, damage: str
) -> None:
    push("wt-toy", make_folder(), 0.5, run_id, uri=store_uri)
    path = only(store_uri, file)
    content = bytearray(path.read_bytes())
    if damage == "byte":
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    elif damage == "truncated":
        path.write_bytes(content[:-7])
    else:
        path.unlink()
    to = tmp_path / "pulled"
    with pytest.raises(RegistryError, match=file) as caught:
        pull("wt-toy@champion", to, uri=store_uri)
    assert "\n" not in str(caught.value) and caught.value.exit_code == 2
    assert not to.exists() and not list(tmp_path.glob(".pull-*"))


def test_a_forged_pair_of_model_and_card_is_found_by_the_tags(
    make_folder: MakeFolder, store_uri: str, run_id: str, tmp_path: Path
) -> None:
    push("wt-toy", make_folder(value=0.5), 0.5, run_id, uri=store_uri)
    forged = make_folder(value=0.01)  # a whole folder, but not the one that was registered
    only(store_uri, "card.json").write_bytes((forged / "card.json").read_bytes())
    with pytest.raises(RegistryError, match=r"card\.json of wt-toy/1"):
        pull("wt-toy/1", tmp_path / "pulled", uri=store_uri)


def test_damage_leaves_what_was_pulled_before(
    make_folder: MakeFolder, store_uri: str, run_id: str, tmp_path: Path
) -> None:
    push("wt-toy", make_folder(), 0.5, run_id, uri=store_uri)
    to = tmp_path / "pulled"
    pull("wt-toy/1", to, uri=store_uri)
    before = {p.name: p.read_bytes() for p in to.iterdir()}
    only(store_uri, "model.onnx").write_bytes(b"junk")
    with pytest.raises(RegistryError):
        pull("wt-toy/1", to, uri=store_uri)
    assert {p.name: p.read_bytes() for p in to.iterdir()} == before


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        ("wt-toy", "NAME@ALIAS or NAME/VERSION"),
        ("wt-toy@", "NAME@ALIAS"),
        ("wt-toy/../1", "NAME@ALIAS"),
        ("wt-toy' OR 1=1/1", "NAME@ALIAS"),
        ("wt-tow/1", "no model 'wt-tow'.*did you mean 'wt-toy'"),
        ("wt-toy@champoin", "no alias 'champoin'.*did you mean 'champion'"),
        ("wt-toy/7", "no version 7; registered: 1"),
    ],
)
def test_what_does_not_exist_is_named_with_what_does(
    make_folder: MakeFolder, store_uri: str, run_id: str, tmp_path: Path, reference: str, said: str
) -> None:
    push("wt-toy", make_folder(), 0.5, run_id, uri=store_uri)
    with pytest.raises(RegistryError, match=said):
        pull(reference, tmp_path / "to", uri=store_uri)


def test_a_store_that_is_missing_broken_or_away_says_so(tmp_path: Path) -> None:
    with pytest.raises(RegistryError, match="no model store"):
        Store(f"sqlite:///{tmp_path}/none.db")
    assert not (tmp_path / "none.db").exists()
    (tmp_path / "junk.db").write_bytes(b"no database at all, whatever it is called" * 100)
    with pytest.raises(WorkError, match=r"junk\.db failed") as caught:
        Store(f"sqlite:///{tmp_path}/junk.db")
    assert "\n" not in str(caught.value)
    with pytest.raises(WorkError, match="no MLflow server answers"):
        Store("http://127.0.0.1:9")


def test_the_default_store_is_found_by_mlflow_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert resolve_uri() == f"sqlite:///{tmp_path}/mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://example.org:5000")
    assert resolve_uri() == "http://example.org:5000"
    assert resolve_uri("sqlite:///x.db") == f"sqlite:///{tmp_path}/x.db"
