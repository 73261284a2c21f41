"""The end of a trial: its seals are opened, and score, page and film are written."""

from __future__ import annotations

from wt.prove import bench, results
from wt.prove.bench import Report
from wt.prove.case_result import CaseResult
from wt.prove.film import film
from wt.prove.folder import Folder
from wt.prove.page import page
from wt.prove.results import Results
from wt.show.files import write_together

REPORT, FILM = "report.html", "trials.rrd"


def finish(folder: Folder, key: bytes | None, jobs: int, say: Report) -> Results:
    """Score a trial whose diagnoses are all recorded.

    Args:
        folder: the trial.
        key: that of cases of others; None for our own.
        jobs: processes.
        say: called with progress.

    Raises:
        WorkError: something was changed since it was recorded.
        DataError: the key is not the right one.
    """
    scored = results.score(folder, bench.opened(folder, key), jobs, say)
    say("drawing", 1.0)
    cases = [CaseResult.from_json(case) for case in scored["cases"]]
    recording = film(folder, cases, folder.plan.who[0])
    write_together(folder.path, {REPORT: page(scored), FILM: recording})
    return scored
