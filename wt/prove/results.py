"""``results.json``: the score of a trial, and its table for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt.prove import guard, tally
from wt.prove.answer import Answer
from wt.prove.bench import Report, workers
from wt.prove.case_result import CaseResult, finite
from wt.prove.contenders import ASK, OURS, PASSPORT
from wt.prove.folder import Folder, write_json
from wt.prove.marks import mark_case
from wt.prove.real import REAL
from wt.prove.tally import Scores

if TYPE_CHECKING:
    from rich.table import Table

RESULTS = "results.json"
Results = dict[str, Any]


def score(folder: Folder, answers: Mapping[str, Answer], jobs: int, say: Report) -> Results:
    """Mark every case and write ``results.json``.

    Args:
        folder: the trial, its seals open.
        answers: case → its answer.
        jobs: processes.
        say: called with progress.
    """
    plan = folder.plan
    cases: list[CaseResult] = []
    with workers(min(jobs, len(answers))) as pool:
        futures = [
            pool.submit(mark_case, folder.cases / name, name, answer, diagnoses(folder, name))
            for name, answer in answers.items()
        ]
        for future in as_completed(futures):
            cases.append(future.result())
            say(
                f"marked {len(cases)} of {len(answers)} cases",
                0.95 + 0.05 * len(cases) / len(answers),
            )
    cases.sort(key=lambda case: case.name)
    results = {
        "schema": 1,
        "set": plan.set,
        "only": plan.only,
        "seed": plan.seed,
        "brought": plan.brought or None,
        "guard": guard.strength(),
        "code": plan.code,
        "code_changed": plan.code != folder.ledger["code"],
        **summary(cases, plan.who),
        "cases": [case.to_json() for case in cases],
    }
    write_json(folder.path / RESULTS, results)
    return results


def diagnoses(folder: Folder, name: str) -> dict[str, Path]:
    """Contender → folder of its diagnosis of a case."""
    return {who: folder.said(who, name) for who in folder.plan.who}


def summary(cases: Sequence[CaseResult], who: Sequence[str]) -> Results:
    """Scores, curves and tables of all contenders.

    Args:
        cases: results of all cases.
        who: the contenders; the first is compared with each of the others.
    """
    scores = {contender: tally.scores(cases, contender) for contender in who}
    first = who[0]
    return {
        "scores": scores,
        "targets": tally.targets(scores[first]),
        "ahead": {rival: tally.ahead(scores[first], scores[rival]) for rival in who[1:]},
        "confusion": {contender: tally.confusion(cases, contender) for contender in who},
        "power": {contender: tally.power(cases, contender) for contender in who},
        "calibration": {contender: tally.calibration(cases, contender) for contender in who},
        "machines": [_machine(case) for case in cases if case.kind == REAL],
    }


def _machine(case: CaseResult) -> Results:
    """Errors on a real machine's held-out motions, and the deviation between its runs."""
    errors: Results = finite(
        {
            "name": case.rig,
            "published_rmse": case.published_rmse,
            "known": case.known,
            "before_rmse": case.before_rmse,
            "after_rmse": case.after_rmse,
            "repeat_rmse": case.noise_rms,
            "findings": {who: result.findings for who, result in case.contenders.items()},
            "seconds": {who: result.seconds for who, result in case.contenders.items()},
        }
    )
    return errors


LABELS = {
    "location": "right place",
    "effect": "right effect",
    "near": "right, or said to be near",
    "unknown": "outsiders: said unknown",
    "unknown_place": "outsiders: right place",
    "false_alarms": "false alarms",
    "extra_claims": "claims too many",
    "coverage": "intervals that hold",
    "parameter_error": "parameter error",
    "improved": "held-out improved",
    "error_left": "held-out error left",
    "error_over_noise": "held-out error / noise",
    "levels": "fleets: right level",
    "changes": "fleets: change told in time",
    "false_changes": "fleets: false change",
    "experiments": "experiments a case",
    "beyond_range": "left a joint's range",
    "seconds": "seconds a case",
    "errors": "ended in an error",
}
"""Labels of the scores on a page, in order."""


def table(results: Results) -> Table:
    """Scores by contender, for a terminal of 80 columns; the first column counts our cases."""
    from rich.table import Table

    shown = Table(box=None, pad_edge=False, header_style="bold")
    shown.add_column("", no_wrap=True)
    shown.add_column("of", justify="right")
    for who in results["scores"]:
        shown.add_column(title(who), justify="right", no_wrap=True)
    first = next(iter(results["scores"].values()))
    for name, label in LABELS.items():
        cells = [cell(name, scores.get(name)) for scores in results["scores"].values()]
        if any(c != "–" for c in cells):
            counted = first[name]["of"] if isinstance(first[name], dict) else ""
            shown.add_row(label, str(counted), *cells)
    return shown


def cell(name: str, score: Scores | float | int | None) -> str:
    """A score as text."""
    number = tally.value(score)
    if number is None:
        return "–"
    if isinstance(score, dict):
        return f"{100 * number:.0f} %"
    if name in ("parameter_error", "error_left"):
        return f"{100 * number:.0f} %" if number > 0.1 else f"{100 * number:.2g} %"
    return f"{number:.1f}" if name in ("error_over_noise", "experiments") else f"{number:.0f}"


def machines(results: Results) -> Table | None:
    """Held-out errors on real machines, for a terminal; None if there are none."""
    from rich.table import Table

    if not results["machines"]:
        return None
    shown = Table(box=None, pad_edge=False, header_style="bold")
    shown.add_column("held-out error, mrad or mm", no_wrap=True)
    for head in ("published", "given", *(map(title, results["scores"])), "floor"):
        shown.add_column(head, justify="right", no_wrap=True)
    for machine in results["machines"]:
        errors = (
            machine["published_rmse"], machine["before_rmse"], *machine["after_rmse"].values(),
            machine["repeat_rmse"],
        )  # fmt: skip
        shown.add_row(machine["name"], *("–" if e is None else f"{1e3 * e:.1f}" for e in errors))
    return shown


def title(who: str) -> str:
    """Name of a contender on a page."""
    return {OURS: "wt diagnose", ASK: "wt ask", PASSPORT: "wt passport"}.get(who, who)


def lines(results: Results) -> list[str]:
    """Remarks below the table."""
    remarks = []
    missed = [t for t in results["targets"] if t["met"] is False]
    for target in missed:
        wanted = f"{100 * target['from']:.0f} to {100 * target['to']:.0f} %"
        reached = f"{100 * target['reached']:.1f} %"
        remarks.append(f"missed: {LABELS[target['score']]} {reached}, wanted {wanted}")
    for who, scores in results["ahead"].items():
        behind = [LABELS[name] for name, better in scores.items() if better is False]
        if behind:
            remarks.append(f"behind {who}: {', '.join(behind)}")
    if results["code_changed"]:
        remarks.append("note: the code was changed while the trial ran")
    return remarks
