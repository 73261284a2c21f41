"""Fetch a registered model and verify every byte of it before anyone can run it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from registry.card import CARD_FILE, MODEL_FILE, Card, sha256
from registry.parity import verify
from registry.reference import is_folder
from registry.store import TRACKING_ERROR, Store, Version
from wt.errors import RegistryError


def pull(reference: str, to: Path, *, uri: str | None = None) -> tuple[Version, Card]:
    """Download a model into the folder ``to`` as ``model.onnx`` and ``card.json``.

    Both files must have the hashes of the version's tags, the model that of its card, and its
    golden pairs must replay. Nothing lands in ``to`` before all of that holds.

    Args:
        reference: ``"wt-r5@champion"`` or ``"wt-r5/3"``.
        to: folder to write; it may exist.
        uri: the store; None for the default one.

    Raises:
        RegistryError: no such version, or its bytes are not those that were registered.
    """
    _refuse_file(reference, to)
    store = Store(uri)
    version = _model(store, reference)
    with _placing(to) as folder:
        fetch(store, version, MODEL_FILE, version.sha256, folder)
        fetch(store, version, CARD_FILE, version.card_sha256, folder)
        card = verify(folder)
    return version, card


def bring(reference: str, to: Path, *, uri: str | None = None) -> Card:
    """Put a model into the folder ``to``, of the registry or from another folder.

    Of a folder, too, the model must have the hash of its card, and its golden pairs must replay.

    Args:
        reference: as of :func:`pull`, or a folder that ``wt registry pull`` or ``wt fit`` left.
        to: folder to write; it may exist.
        uri: the store; None for the default one. Without need of it none is reached.

    Raises:
        RegistryError: as :func:`pull`; there is no such folder, or no model in it.
    """
    if not is_folder(reference):
        return pull(reference, to, uri=uri)[1]
    source = Path(reference)
    if not source.is_dir():
        raise RegistryError(
            f"{reference!r} is no folder, and no model of the registry either; name the folder "
            f"with {MODEL_FILE} and {CARD_FILE}, or write NAME@ALIAS or NAME/VERSION"
        )
    _refuse_file(reference, to)
    verify(source)  # first, so that what is wrong is said of the folder that was named
    with _placing(to) as folder:
        for file in (MODEL_FILE, CARD_FILE):
            shutil.copyfile(source / file, folder / file)
        return verify(folder)


def _refuse_file(reference: str, to: Path) -> None:
    if to.exists() and not to.is_dir():
        raise RegistryError(f"{to} is a file; name a folder to pull {reference} into")


@contextmanager
def _placing(to: Path) -> Iterator[Path]:
    """A folder beside ``to``, whose model and card are moved there if all goes well."""
    to.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=to.parent, prefix=".pull-") as name:
        yield Path(name)
        to.mkdir(exist_ok=True)
        for file in (MODEL_FILE, CARD_FILE):
            os.replace(Path(name) / file, to / file)


def read_card(reference: str, *, uri: str | None = None) -> tuple[Version, Card]:
    """The version and its card, without the model.

    Raises:
        RegistryError: as :func:`pull`.
    """
    store = Store(uri)
    version = _model(store, reference)
    with tempfile.TemporaryDirectory() as name:
        fetch(store, version, CARD_FILE, version.card_sha256, Path(name))
        return version, Card.load(Path(name))


def fetch(store: Store, version: Version, file: str, expected: str, folder: Path) -> None:
    """Download one file of a version and verify its hash.

    Raises:
        RegistryError: it is gone, or its bytes are not those that were registered.
    """
    actual = sha256(store.fetch(version, file, folder))
    if actual != expected:
        raise RegistryError(
            f"{file} of {version} has sha256 {actual[:12]}…, registered was {expected[:12]}…: "
            "its bytes were changed; restore them, or register the model again"
        )


def _model(store: Store, reference: str) -> Version:
    version = store.resolve(reference)
    if version.heldout.metric == TRACKING_ERROR:
        raise RegistryError(
            f"{version} is a walking policy, not a model of wt fit; wt-run --policy runs it"
        )
    return version
