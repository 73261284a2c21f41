"""What ``wt reproduce`` leaves: ``report.md`` and ``single_step.png``."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from wt.evaluate.results import ASSUMPTION
from wt.reproduce.table import Found, figure, head, missing, rows
from wt.reproduce.tasks import Task
from wt.show.files import write_together
from wt.show.text import markdown_table

REPORT, FIGURE = "report.md", "single_step.png"


def write(folder: Path, found: Found, left_out: Sequence[Task]) -> Path:
    """Write the report of some tasks.

    Args:
        folder: where it goes; the runs lie below it.
        found: the results by task.
        left_out: tasks that could not be run.

    Returns:
        The report's path.
    """
    seeds = sorted({len(results.seeds) for results in found.values()})
    count = " or ".join(str(n) for n in seeds)
    lines = [
        "# Single-step prediction on the paper's tasks",
        "",
        *markdown_table(head(found), rows(found)),
        "",
        f"MSE of the normalised next state under teacher forcing, in units of RawSim's, mean over "
        f"{count} seed{'s' if seeds != [1] else ''}; the paper's from its figure 3. {ASSUMPTION}",
        "",
        missing(left_out),
        "",
        f"![Single-step errors by robot and condition]({FIGURE})",
        "",
        *(
            f"- [{task.name}]({task.name}/results.md): {results.model or 'not registered'}"
            + (f", version {results.version}" if results.version else "")
            for task, results in found.items()
        ),
    ]
    png = BytesIO()
    figure(found).savefig(png, format="png", dpi=150)
    write_together(folder, {REPORT: "\n".join(lines) + "\n", FIGURE: png.getvalue()})
    return folder / REPORT
