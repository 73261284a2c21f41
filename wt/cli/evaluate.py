"""``wt evaluate``: a registered model on its task."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    reference: Annotated[
        str, typer.Argument(metavar="MODEL", help="NAME@ALIAS or NAME/VERSION, as wt-r5@champion.")
    ],
    config: Annotated[
        Path,
        typer.Option(help="YAML file of its task, or a shipped name, as r5."),
    ],
    overrides: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Override what it says.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results [default: runs/MODEL-evaluated].")
    ] = None,
) -> None:
    """Evaluate a registered model: single-step errors beside the simulator's, rollouts of walkers.

    Its bytes are verified first. Transitions of the task are collected, or reused; the test pairs
    are those of the configuration. Leaves results.json, results.md and the figures in --out.
    wt reproduce trains, and evaluates, everything else that the paper reports.

    Example:
        wt evaluate wt-r5@champion --config r5
        wt evaluate wt-go2-payload/2 --config go2_payload --out runs/payload
    """
    from rich.console import Console

    from wt.cli._progress import bars
    from wt.config import load
    from wt.registered import evaluate

    settings = load(config, overrides or [])
    folder = out or Path("runs") / f"{reference.replace('/', '-').replace('@', '-')}-evaluated"
    with bars() as listener:
        results = evaluate(reference, settings, folder, listener)
    console = Console()
    results.print_table(console)
    console.print(f"{folder}", highlight=False, soft_wrap=True)
