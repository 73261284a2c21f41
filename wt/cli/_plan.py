"""``wt diagnose MODEL.xml --plan``: what could be told apart, before anything is recorded."""

from __future__ import annotations

import json
from pathlib import Path

from wt.errors import UserError

PLAN, PAGE = "plan.json", "plan.html"


def write_plan(model: Path, out: Path) -> None:
    """Print what could be told apart, and write ``plan.json`` and ``plan.html``.

    Args:
        model: the MJCF.
        out: folder for both; new, empty, or of an earlier plan.

    Raises:
        UserError: the folder holds anything else.
    """
    from rich.console import Console

    from wt.ask.plan import plan
    from wt.ask.plan_page import page, sentences
    from wt.cli._progress import bar
    from wt.show.files import kept, write_together

    with kept(out):
        _refuse_foreign(out)
        with bar("simulating") as progress:
            found = plan(model, progress)
        said = json.dumps(found.to_json(), indent=2, ensure_ascii=False)
        write_together(out, {PAGE: page(found, model.name), PLAN: said + "\n"})
    console = Console()
    for line in sentences(found):
        console.print(line, highlight=False)
    console.print(f"\n{out / PAGE}", highlight=False, soft_wrap=True)


def _refuse_foreign(out: Path) -> None:
    there = {p.name for p in out.iterdir() if not p.name.startswith(".")}
    try:
        ours = not there or "only_replays_tell" in json.loads((out / PLAN).read_text("utf-8"))
    except (OSError, ValueError, TypeError, RecursionError):
        ours = False
    if not ours or there - {PLAN, PAGE}:
        raise UserError(
            f"--out {out} holds what no wt diagnose --plan wrote; name a new or empty folder"
        )
