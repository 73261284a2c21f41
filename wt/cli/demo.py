"""``wt demo``: both halves of the package on small examples."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    out: Annotated[Path, typer.Option(help="Folder of it all, new or empty.")] = Path("demo"),
) -> None:
    """Diagnose two small machines, train a small translation, and say what to open.

    Takes about a minute and a half on two cores, without a network. Prints each command as it could
    be typed in the folder, what that printed, and what had been hidden in the machines. Everything
    is in --out: the examples, the diagnoses, the run, and MLflow's store.

    Example:
        wt demo
        wt demo --out /tmp/demo
    """
    from wt.cli._extras import need
    from wt.cli._progress import waiting
    from wt.demo import demonstrate

    need("lightning", "mlflow", "rerun")
    with waiting("two diagnoses and a fit, a minute and a half") as (say, note):
        demonstrate(out, say, note)
