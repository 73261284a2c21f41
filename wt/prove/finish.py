"""Opens the seals and writes everything that a trial leaves: score, page and film."""

from __future__ import annotations

from wt.prove import bench, results
from wt.prove.bench import Report
from wt.prove.film import film
from wt.prove.folder import Folder
from wt.prove.page import page
from wt.prove.results import Results
from wt.show.files import write_together

REPORT, FILM = "report.html", "trials.rrd"


def finish(folder: Folder, key: bytes | None, jobs: int, say: Report) -> Results:
    """Score a trial of which everything is said.

    Args:
        folder: the trial.
        key: that of cases of others; None for our own.
        jobs: processes.
        say: told of progress.

    Raises:
        WorkError: something was changed since it was recorded.
        DataError: the key is not the right one.
    """
    found = results.score(folder, bench.opened(folder, key), jobs, say)
    say("drawing", 1.0)
    shown = film(folder, found["cases"], folder.plan.who[0])
    write_together(folder.path, {REPORT: page(found), FILM: shown})
    return found
