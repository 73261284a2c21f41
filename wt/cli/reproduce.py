"""``wt reproduce``: the paper's evaluation, and what goes beyond it, in one report."""

from __future__ import annotations

import functools
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
    only: Annotated[
        list[str] | None,
        typer.Option(help="Only this table or figure, as table-1; may be repeated."),
    ] = None,
    conf: Annotated[Path | None, typer.Option(help="Folder of other configurations.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Small models and little data: shows that it runs.")
    ] = False,
) -> None:
    """Redo the paper's tables and figures and what goes beyond them; one report, HTML and Markdown.

    Without --only all are done, with seeds 0, 1 and 2. Each task is a run of wt fit in its own
    folder below --out, and every model is trained once: what is finished is reused, also by other
    tables, and what was interrupted is continued. The report holds all that is known so far.

    Example:
        wt reproduce
        wt reproduce --quick --out runs/quick
        wt reproduce --only table-1 --only table-2 seeds=[0]
        wt reproduce --task go2_flat --task go2_payload --out runs/go2
    """
    from rich.console import Console

    from wt.cli._progress import bars
    from wt.errors import WorkError
    from wt.reproduce.report import tell
    from wt.reproduce.run import reproduce
    from wt.shipped import folder

    console = Console()

    try:
        page = reproduce(
            conf or folder("conf"), out, only=only or [], tasks=task or [],
            overrides=overrides or [], quick=quick, bars=bars,
            say=functools.partial(tell, console=console),
        )  # fmt: skip
    except KeyboardInterrupt as error:
        raise WorkError(
            "interrupted: nothing finished is lost; run the same command again to continue"
        ) from error
    console.print(f"{page}", highlight=False, soft_wrap=True)
