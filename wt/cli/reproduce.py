"""``wt reproduce``: the paper's tasks, one after another, and one report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE]...", help="Override what the configurations say."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the report and of the runs.")] = Path(
        "runs/reproduce"
    ),
    task: Annotated[
        list[str] | None, typer.Option(help="Only this task, as go2_payload; may be repeated.")
    ] = None,
    conf: Annotated[Path, typer.Option(help="Folder of the configurations.")] = Path("conf"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Small models and little data: shows that it runs.")
    ] = False,
) -> None:
    """Run the paper's tasks and write one table and figure, the paper's numbers beside ours.

    Each task is a run of wt fit in its own folder below --out. What is finished there is reused,
    what was interrupted is continued.

    Example:
        wt reproduce seeds=[0,1,2]
        wt reproduce --task go2_flat --task go2_payload --out runs/go2
    """
    from rich.console import Console

    from wt.cli._progress import bars
    from wt.errors import WorkError
    from wt.reproduce.report import write
    from wt.reproduce.table import head, missing, rows
    from wt.reproduce.tasks import QUICK, chosen, run
    from wt.show.text import terminal_table

    tasks, left_out = chosen(task or [], conf)
    words = [*(QUICK if quick else ()), *(overrides or [])]
    found = {}
    try:
        for one in tasks:
            with bars() as listener:
                found[one] = run(one, conf, out / one.name, words, listener)
    except KeyboardInterrupt as error:
        raise WorkError(
            "interrupted: nothing finished is lost; run the same command again to continue"
        ) from error
    report = write(out, found, left_out)
    console = Console()
    console.print(terminal_table(head(found), rows(found)))
    if left_out:
        console.print(missing(left_out), highlight=False)
    console.print(f"{report}", highlight=False, soft_wrap=True)
