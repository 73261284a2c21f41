"""``wt verify``: replays what ``wt diagnose`` wrote and prints its figures again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wt.errors import UserError, WorkError


def command(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="The folder that wt diagnose --out wrote.")
    ],
) -> None:
    """Replay a diagnosis's files in plain MuJoCo and print their figures again.

    A process that has only DIR replays the held-out recordings from the starts in holdout.npz:
    once with model.xml alone, once with physics.py too, which it runs. Exit code 1 if the figures
    are not those of diagnosis.json.

    Example:
        wt verify diagnosis
    """
    from rich.console import Console

    from wt.cli._progress import bar
    from wt.diagnose.report.text import verified
    from wt.diagnose.report.verify import verify

    if not folder.is_dir():
        raise UserError(f"'{folder}' is no folder; give the one that wt diagnose --out wrote")
    with bar("replaying") as progress:
        progress("replaying the files", 0.1)
        verified_files = verify(folder)
    Console().print(verified(verified_files), highlight=False, soft_wrap=True)
    if not verified_files.agrees:
        raise WorkError(
            f"these are not the figures of '{folder}/diagnosis.json': its files were changed, or "
            "another version of MuJoCo runs them"
        )
