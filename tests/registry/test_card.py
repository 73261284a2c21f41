"""Cards read back as written, and nothing else reads as a card."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from registry.card import Card
from wt.errors import RegistryError


def test_says_what_the_spec_says(make_folder: Callable[..., Path]) -> None:
    folder = make_folder(value=0.5)
    said = json.loads((folder / "card.json").read_text())
    assert said["schema"] == 1
    assert (said["task"], said["rate_hz"], said["joints"]) == ("toy", 50.0, ["hip", "knee"])
    assert [(p["name"], p["shape"]) for p in said["inputs"]] == [
        ("o", ["batch", 3]),
        ("a", ["batch", 2]),
        ("o_next_sim", ["batch", 3]),
    ]
    assert said["outputs"][0]["channels"][2] == {"name": "v", "unit": "rad/s"}
    assert said["sha256"] == hashlib.sha256((folder / "model.onnx").read_bytes()).hexdigest()
    assert said["heldout"] == {
        "set": "pairs/test",
        "data_hash": "heldout-1",
        "metric": "mse",
        "value": 0.5,
    }
    assert {"python", "torch", "onnxruntime"} <= said["packages"].keys()


def test_round_trip_is_exact(
    make_folder: Callable[..., Path],
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
    tmp_path: Path,
) -> None:
    card = Card.load(make_folder())
    card.save(tmp_path)
    assert Card.load(tmp_path) == card
    for got, put in zip(card.golden.arrays(), rows, strict=False):
        assert got.dtype == np.float32
        np.testing.assert_array_equal(got, put)
    with pytest.raises(dataclasses.FrozenInstanceError):
        card.name = "other"  # type: ignore[misc]


def change(key: str, value: object) -> Callable[[dict[str, Any]], None]:
    def apply(card: dict[str, Any]) -> None:
        *path, last = key.split(".")
        for part in path:
            card = card[int(part)] if isinstance(card, list) else card[part]
        card[last] = value

    return apply


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda card: card.pop("commit"), "commit"),
        (change("colour", "red"), "colour"),
        (change("heldout.colour", "red"), "heldout.colour"),
        (change("inputs.0.channels.0.colour", "red"), "colour"),
        (change("schema", 2), "schema"),
        (change("rate_hz", "50"), "rate_hz"),
        (change("sha256", "abc"), "sha256"),
        (change("created", "yesterday"), "created"),
        (change("heldout.value", float("nan")), "heldout.value"),
        (change("inputs.1.shape", ["batch", 3]), "inputs.1"),
        (change("outputs.0.name", "colour"), "colour"),
        (lambda card: card["golden"]["a"].pop(), "golden 'a' has 4 rows"),
        (lambda card: card["golden"]["o"][0].pop(), "golden 'o'"),
    ],
)
def test_a_missing_foreign_or_wrong_key_is_refused_in_one_line(
    make_folder: Callable[..., Path], damage: Callable[[dict[str, Any]], None], said: str
) -> None:
    path = make_folder() / "card.json"
    card = json.loads(path.read_text())
    damage(card)
    path.write_text(json.dumps(card))
    with pytest.raises(RegistryError) as caught:
        Card.load(path.parent)
    message = str(caught.value)
    assert said in message and str(path) in message and "\n" not in message


def test_truncated_or_absent_card(make_folder: Callable[..., Path], tmp_path: Path) -> None:
    path = make_folder() / "card.json"
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(RegistryError, match="Invalid JSON"):
        Card.load(path.parent)
    with pytest.raises(RegistryError, match=r"has no card\.json"):
        Card.load(tmp_path)
