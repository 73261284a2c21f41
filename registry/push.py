"""Register a model; the alias ``champion`` moves only to a better one."""

from __future__ import annotations

import math
from pathlib import Path

from registry import mlmodel
from registry.card import CARD_FILE, MODEL_FILE, Card, HeldOut, sha256
from registry.parity import TOLERANCE, verify
from registry.pull import pull
from registry.store import About, Store, Version
from wt.errors import RegistryError

CHAMPION = "champion"


def push(
    name: str, model_dir: Path, metric: float, run_id: str, *, uri: str | None = None
) -> Version:
    """Register ``model.onnx`` and ``card.json`` of a folder as the next version of ``name``.

    A run registers a model once. Pushed again, as a resumed run does, the model keeps its version,
    what an interrupted push left open is done, and the folder gets the card that was registered.

    Args:
        name: registered name, e.g. ``"wt-r5"``.
        model_dir: the folder.
        metric: the held-out metric as just measured; lower is better.
        run_id: MLflow run that made the model.
        uri: the store; None for the default one.

    Returns:
        The version; ``decision`` says why it is champion or why it is not.

    Raises:
        RegistryError: the bytes are not the card's, the golden pairs do not replay, parity was
            not checked or is too coarse, or ``metric`` and ``name`` are not the card's.
    """
    card = verify(model_dir)
    if card.parity is None or not card.parity <= TOLERANCE:
        parity = "none" if card.parity is None else f"{card.parity:.1e}"
        raise RegistryError(
            f"{model_dir}: parity with the eager model is {parity}, at most {TOLERANCE:.0e} is "
            "needed to register; run registry.parity.check on the export and write a new card"
        )
    if card.name != name or not math.isclose(card.heldout.value, metric, rel_tol=1e-9):
        raise RegistryError(
            f"{model_dir}: the card is of {card.name!r} with {card.heldout.metric} "
            f"{card.heldout.value:g}, not of {name!r} with {metric:g}; write a new card"
        )
    store = Store(uri, create=True)
    versions = store.versions(name)
    champion = next((v for v in versions if CHAMPION in v.aliases), None)
    wins, decision = compare(card.heldout, champion)
    mine = (run_id, card.sha256, card.heldout)
    made = next((v for v in versions if (v.run_id, v.sha256, v.heldout) == mine), None)
    if made is None:
        tags = {
            "sha256": card.sha256,
            "card_sha256": sha256(model_dir / CARD_FILE),
            "decision": decision,
            "task": card.task,
            "commit": card.commit,
        }
        files = mlmodel.Files(model_dir / MODEL_FILE, model_dir / CARD_FILE, _frames(card), run_id)
        number = store.add(name, run_id, files.write, card.heldout, tags, _about(card))
        made = store.resolve(f"{name}/{number}")
    else:
        pull(str(made), model_dir, uri=uri)
    if not made.settled:
        if wins:
            store.set_alias(made, CHAMPION)
        store.settle(made)
    return store.resolve(str(made))


def compare(new: HeldOut, champion: Version | None) -> tuple[bool, str]:
    """Decide if a new model becomes champion, and say why or why not.

    Only the same metric on the same held-out data is comparable.
    """
    if champion is None:
        return True, "champion: the first one"
    old = champion.heldout
    if (new.metric, new.data_hash) != (old.metric, old.data_hash):
        return False, (
            f"not champion: measured as {new.metric} on {new.set} {new.data_hash[:12]}, "
            f"{champion} as {old.metric} on {old.set} {old.data_hash[:12]}, which does not "
            "compare; 'wt registry promote' moves the alias by hand"
        )
    if new.value < old.value:
        return True, f"champion: {new.metric} {new.value:.6g} < {old.value:.6g} of {champion}"
    return False, f"not champion: {new.metric} {new.value:.6g} >= {old.value:.6g} of {champion}"


def _frames(card: Card) -> mlmodel.Frames:
    inputs, outputs = (
        {port.name: [c.name for c in port.channels] for port in ports}
        for ports in (card.inputs, card.outputs)
    )
    example = dict(zip(inputs, card.golden.arrays(), strict=False))
    return mlmodel.Frames(inputs, outputs, example)


def _about(card: Card) -> About:
    """Words on a model and on one version of it."""
    measured = f"{card.heldout.metric} {card.heldout.value:.4g} on {card.heldout.set}"
    rows = [f"| {name} | {value:.4g} |" for name, value in card.metrics.items()]
    table = ["| on the test pairs | error |", "| --- | ---: |", *rows] if rows else []
    behind = ", ".join(f"`{port.name}`" for port in card.outputs[1:])
    features = f"Features ({behind}): {card.features}.\n\n" if card.features else ""
    return About(
        f"World Translation for the task `{card.task}`: from an observation, an action and the "
        "simulator's next observation to the real robot's next observation, in physical units "
        f"at {card.rate_hz:g} Hz. Joints: {', '.join(card.joints)}.",
        # no bold here: lists of versions show the beginning as it stands
        f"{measured} is what versions are compared by; MSE is of the normalised next state.\n\n"
        f"{features}"
        f"Trained from data {card.data_hash} by commit {card.commit[:12]}; `card.json` beside the "
        "graph has the rest. `mlflow.pyfunc.load_model` takes a frame with one column a channel, "
        "as in the example.\n\n" + "\n".join(table),
    )
