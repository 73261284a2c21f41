"""Walking policies in the registry: ``policy.onnx`` and its card, beside the models of ``wt fit``.

A policy's folder is what wt-train-policy leaves. Its card is another than a model's, and is read
here only as far as the registry needs: the robot's side checks that the policy fits.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from registry import mlmodel
from registry.card import CARD_FILE, HeldOut, sha256
from registry.pull import fetch
from registry.push import CHAMPION, compare
from registry.store import TRACKING_ERROR, About, Store, Version
from wt.errors import RegistryError

POLICY_FILE = "policy.onnx"
_NEEDED = {"name", "robot", "task", "commit", "sha256", "observation", "joints", "rate_hz"}


def push(folder: Path, run_id: str, *, uri: str | None = None) -> Version:
    """Register a policy as the next version of the name on its card.

    ``champion`` moves to it if it follows commands better than the champion in the same trials.

    Args:
        folder: with ``policy.onnx`` and ``card.json``.
        run_id: MLflow run that it belongs to.
        uri: the store; None for the default one.

    Returns:
        The version; the one it has already, if these very files are registered.

    Raises:
        RegistryError: a file is missing, the graph is not the card's, or it was never evaluated.
    """
    card = _read(folder)
    actual = sha256(folder / POLICY_FILE)
    if actual != card["sha256"]:
        raise RegistryError(
            f"{folder / POLICY_FILE} has sha256 {actual[:12]}…, its card says "
            f"{str(card['sha256'])[:12]}…: export the policy again"
        )
    heldout = _heldout(card, folder)
    store = Store(uri, create=True)
    hashes = {"sha256": actual, "card_sha256": sha256(folder / CARD_FILE)}
    versions = store.versions(card["name"])
    same = next((v for v in versions if v.card_sha256 == hashes["card_sha256"]), None)
    if same is not None:
        return same
    wins, decision = compare(heldout, next((v for v in versions if CHAMPION in v.aliases), None))
    about: dict[str, str] = {
        k: str(card[k]) for k in ("robot", "task", "commit", "made_by") if k in card
    }
    tags = hashes | about | {"decision": decision}
    files = mlmodel.Files(folder / POLICY_FILE, folder / CARD_FILE, _frames(card), run_id)
    number = store.add(card["name"], run_id, files.write, heldout, tags, _about(card, heldout))
    made = store.resolve(f"{card['name']}/{number}")
    if wins:
        store.set_alias(made, CHAMPION)
    store.settle(made)
    return store.resolve(str(made))


def pull(reference: str, to: Path, *, uri: str | None = None) -> Version:
    """Download a policy into the folder ``to``; nothing lands there that was not registered so.

    Args:
        reference: ``"go2@champion"`` or ``"go2/3"``.
        to: folder to write; it may exist.
        uri: the store; None for the default one.

    Raises:
        RegistryError: no such version, it is no policy, or its bytes are not those registered.
    """
    store = Store(uri)
    version = store.resolve(reference)
    if not is_policy(version):
        raise RegistryError(f"{version} is no walking policy but a model of wt fit")
    if to.exists() and not to.is_dir():
        raise RegistryError(f"{to} is a file; name a folder to pull {reference} into")
    to.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=to.parent, prefix=".pull-") as name:
        folder = Path(name)
        fetch(store, version, POLICY_FILE, version.sha256, folder)
        fetch(store, version, CARD_FILE, version.card_sha256, folder)
        to.mkdir(exist_ok=True)
        for file in (POLICY_FILE, CARD_FILE):
            os.replace(folder / file, to / file)
    return version


def is_policy(version: Version) -> bool:
    """True if a registered version is a walking policy."""
    return version.heldout.metric == TRACKING_ERROR


def _read(folder: Path) -> dict[str, Any]:
    for file in (POLICY_FILE, CARD_FILE):
        if not (folder / file).is_file():
            raise RegistryError(
                f"{folder} has no {file}; a policy is a folder with {POLICY_FILE} and {CARD_FILE}, "
                "as wt-train-policy leaves it"
            )
    try:
        card = json.loads((folder / CARD_FILE).read_text(encoding="utf-8"))
    except ValueError as error:
        raise RegistryError(
            f"{folder / CARD_FILE} is not JSON ({error}); export the policy again"
        ) from error
    if not isinstance(card, dict) or not set(card) >= _NEEDED:
        raise RegistryError(f"{folder / CARD_FILE} is no card of a policy; export the policy again")
    return card


def _heldout(card: dict[str, Any], folder: Path) -> HeldOut:
    """A policy's error in following commands, and a hash of what it was tried in."""
    trials = card.get("evaluation", {}).get("tracking")
    if not trials:
        raise RegistryError(
            f"{folder / CARD_FILE} has no evaluation, by which versions are compared; train or "
            "resume with wt-train-policy, which evaluates in the end"
        )
    config = card.get("config", {})
    tried = [card["robot"], config.get("scene"), config.get("physics")]
    tried += [[trial["axis"], trial["command"]] for trial in trials]
    text = json.dumps(tried, sort_keys=True)
    error = sum(float(trial["error"]) for trial in trials) / len(trials)
    return HeldOut("walk", hashlib.sha256(text.encode()).hexdigest(), TRACKING_ERROR, error)


def _frames(card: dict[str, Any]) -> mlmodel.Frames:
    rest = np.zeros((1, len(card["observation"])))
    inputs, outputs = {"observation": card["observation"]}, {"action": card["joints"]}
    return mlmodel.Frames(inputs, outputs, {"observation": rest})


def _about(card: dict[str, Any], heldout: HeldOut) -> About:
    """Words on a policy and on one version of it."""
    return About(
        f"Walking policy of the robot `{card['robot']}` at {card['rate_hz']:g} Hz: from an "
        "observation to the offsets of its joints' targets, in units of the action scale on its "
        "card.",
        f"Error in following commands {heldout.value:.4g} (mean over the trials on its card). "
        f"Trained for `{card['task']}` by commit {card['commit'][:12]}. "
        "`wt-run --policy` runs it on the robot.",
    )
