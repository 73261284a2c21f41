"""``wt registry``: list, show, pull and promote registered models."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    help="The registry of ONNX models, kept in MLflow (MLFLOW_TRACKING_URI, else ./mlflow.db).",
    no_args_is_help=True,
)

Reference = Annotated[
    str, typer.Argument(metavar="NAME@ALIAS|NAME/VERSION", help="e.g. wt-r5@champion or wt-r5/3.")
]


@app.command("list")
def list_models(
    name: Annotated[str | None, typer.Argument(help="Only this model's versions.")] = None,
) -> None:
    """List registered models with their aliases and held-out metric.

    Example:
        wt registry list
    """
    from rich.console import Console
    from rich.table import Table

    from registry.store import Store
    from wt.errors import RegistryError, suggest

    with _busy("reading the registry"):
        store = Store()
        names = list(store.models())
        if name is not None and name not in names:
            hint = suggest(name, names) if names else "the registry is empty, run 'wt fit' first"
            raise RegistryError(f"no model {name!r} in {store.uri}; {hint}")
        versions = [v for n in (names if name is None else [name]) for v in store.versions(n)]
    table = Table("model", "alias", "held-out", "on", "created (UTC)", "sha256", box=None)
    for v in versions:
        heldout = f"{v.heldout.metric} {v.heldout.value:.6g}"
        where = f"{v.heldout.set} {v.heldout.data_hash[:8]}"
        table.add_row(str(v), ", ".join(v.aliases), heldout, where, v.created[:19], v.sha256[:12])
    Console(markup=False).print(table)


@app.command()
def show(reference: Reference) -> None:
    """Show a model's card: channels and units, metrics, parity, hashes.

    The bare name of a policy of the package shows that one's card.

    Example:
        wt registry show wt-r5@champion
        wt registry show go2
    """
    from rich.console import Console
    from rich.table import Table

    from registry.pull import read_card
    from wt.worlds.policy import SHIPPED

    if "/" not in reference and (SHIPPED / reference).is_dir():
        _show_policy(SHIPPED / reference)
        return

    with _busy(f"reading {reference}"):
        version, card = read_card(reference)
    facts = Table("", "", box=None, show_header=False)
    parity = "not checked" if card.parity is None else f"{card.parity:.1e}"
    for key, value in {
        "model": f"{version}  {' '.join('@' + a for a in version.aliases)}",
        "task": f"{card.task}, {card.rate_hz:g} Hz",
        "joints": ", ".join(card.joints),
        "held-out": f"{card.heldout.metric} {card.heldout.value:.6g} on {card.heldout.set} "
        f"({card.heldout.data_hash[:12]})",
        "decision": version.decision,
        "parity": f"{parity} (ONNX against eager)",
        "golden": f"{len(card.golden.o)} rows",
        "features": card.features or "not said",
        "sha256": card.sha256,
        "data": card.data_hash,
        "config": card.config_hash,
        "commit": card.commit,
        "run": version.run_id,
        "created": card.created,
        "packages": ", ".join(f"{k} {v}" for k, v in card.packages.items()),
    }.items():
        facts.add_row(key, value)
    ports = Table("port", "shape", "channels", box=None)
    for port in (*card.inputs, *card.outputs):
        channels = ", ".join(f"{c.name} [{c.unit}]" for c in port.channels)
        ports.add_row(port.name, f"batch x {port.shape[1]}", channels)
    metrics = Table("metric", "value", box=None)
    for key, number in card.metrics.items():
        metrics.add_row(key, f"{number:.6g}")
    console = Console(markup=False)  # a unit in brackets is no markup
    for table in (facts, ports, metrics):
        console.print(table)


def _show_policy(folder: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from wt.worlds.policy import CARD, GRAPH, PolicyCard

    card = PolicyCard.read(folder / CARD)
    facts = Table("", "", box=None, show_header=False)
    for key, value in {
        "policy": f"{card.name}, of the package",
        "task": card.task,
        "robot": f"{card.robot}, {card.rate_hz:g} Hz",
        "MJCF": f"wt model {card.robot} > {card.robot}.xml",
        "joints": ", ".join(card.joints),
        "commands": ", ".join(f"±{limit:g}" for limit in card.command_limits),
        "graph": str(folder / GRAPH),
        "sha256": card.sha256,
        "made by": card.made_by,
        "commit": card.commit,
        "created": card.created,
    }.items():
        facts.add_row(key, value)
    Console(markup=False).print(facts)


@app.command()
def push(
    folder: Annotated[
        Path, typer.Argument(metavar="POLICY", help="Folder of wt-train-policy, or of the package.")
    ],
) -> None:
    """Register a walking policy under the name on its card; wt fit registers models by itself.

    Example:
        wt registry push runs/policy-go2
    """
    from registry.policies import push as push_policy
    from wt.run import track
    from wt.worlds.policy import folder_of

    with _busy(f"registering {folder}"):
        policy = folder_of(folder)
        with track.run("policies", policy.name) as run:
            said = f"The walking policy in `{policy}`, registered as it is; its card says the rest."
            run.tags({track.NOTE: said})
            version = push_policy(policy, run.id)
    typer.echo(f"{version}: {version.decision}")


@app.command()
def pull(
    reference: Reference,
    to: Annotated[
        Path | None, typer.Option("--to", help="Folder to write [default: NAME-VERSION].")
    ] = None,
) -> None:
    """Download a model or a policy, verify its bytes and replay a model's golden pairs.

    Example:
        wt registry pull wt-r5@champion --to models/r5
    """
    from registry import policies
    from registry.pull import pull as pull_model
    from registry.store import Store

    with _busy(f"pulling {reference}"):
        version = Store().resolve(reference)
        folder = to or Path(str(version).replace("/", "-"))
        if policies.is_policy(version):
            policies.pull(reference, folder)
            typer.echo(f"{folder}: {version}, sha256 {version.sha256[:12]} verified")
            return
        version, card = pull_model(reference, folder)
    typer.echo(
        f"{folder}: {version}, sha256 {card.sha256[:12]} verified, "
        f"{len(card.golden.o)} golden pairs replayed"
    )


@app.command()
def promote(
    reference: Reference,
    alias: Annotated[str, typer.Option(help="The alias to move.")] = "champion",
) -> None:
    """Let an alias stand for this version, whatever its metric.

    Example:
        wt registry promote wt-r5/3
    """
    from registry.store import Store

    with _busy(f"promoting {reference}"):
        store = Store()
        version = store.resolve(reference)
        store.set_alias(version, alias)
    typer.echo(f"{version.name}@{alias} is now {version}")


@contextmanager
def _busy(what: str) -> Iterator[None]:
    """A spinner on stderr; nothing where stderr is no terminal."""
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield
