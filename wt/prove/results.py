"""``results.json``: the score of a trial, and its table for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt.prove import guard, tally
from wt.prove.answer import Answer
from wt.prove.bench import Report, workers
from wt.prove.contenders import OURS
from wt.prove.folder import Folder, write_json
from wt.prove.marks import Row, row
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
        answers: case → what is hidden in it.
        jobs: processes.
        say: told of progress.
    """
    plan = folder.plan
    rows: list[Row] = []
    with workers(min(jobs, len(answers))) as pool:
        futures = [
            pool.submit(row, folder.cases / name, name, answer, said(folder, name))
            for name, answer in answers.items()
        ]
        for future in as_completed(futures):
            rows.append(future.result())
            say(
                f"marked {len(rows)} of {len(answers)} cases",
                0.95 + 0.05 * len(rows) / len(answers),
            )
    rows.sort(key=lambda r: str(r["name"]))
    results = {
        "schema": 1,
        "set": plan.set,
        "only": plan.only,
        "seed": plan.seed,
        "brought": plan.brought or None,
        "guard": guard.strength(),
        "code": plan.code,
        "code_changed": plan.code != folder.ledger["code"],
        **summary(rows, plan.who),
        "cases": rows,
    }
    write_json(folder.path / RESULTS, results)
    return results


def said(folder: Folder, name: str) -> dict[str, Path]:
    """Who → folder of what that one said of a case."""
    return {who: folder.said(who, name) for who in folder.plan.who}


def summary(rows: Sequence[Row], who: Sequence[str]) -> Results:
    """Scores of everybody, and the curves and tables of ours."""
    every = {one: tally.scores(rows, one) for one in who}
    first = who[0]
    return {
        "scores": every,
        "targets": tally.targets(every[first]),
        "ahead": {one: tally.ahead(every[first], every[one]) for one in who[1:]},
        "confusion": {one: tally.confusion(rows, one) for one in who},
        "power": {one: tally.power(rows, one) for one in who},
        "calibration": {one: tally.calibration(rows, one) for one in who},
        "machines": [_machine(row) for row in rows if row["kind"] == REAL],
    }


def _machine(row: Row) -> Results:
    """What is known of a real machine: errors on held-out motions, and how runs differ."""
    return {
        "name": row["rig"],
        "before_rmse": row["before_rmse"],
        "after_rmse": row["after_rmse"],
        "repeat_rmse": row["noise_rms"],
        "findings": {who: said["findings"] for who, said in row["said"].items()},
    }


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
    "seconds": "seconds a case",
    "errors": "ended in an error",
}
"""What scores are called on a page, in order."""


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
    found = tally.value(score)
    if found is None:
        return "–"
    if isinstance(score, dict):
        return f"{100 * found:.0f} %"
    if name in ("parameter_error", "error_left"):
        return f"{100 * found:.0f} %" if found > 0.1 else f"{100 * found:.2g} %"
    return f"{found:.1f}" if name == "error_over_noise" else f"{found:.0f}"


def machines(results: Results) -> Table | None:
    """Held-out errors on real machines, for a terminal; None if there are none."""
    from rich.table import Table

    if not results["machines"]:
        return None
    shown = Table(box=None, pad_edge=False, header_style="bold")
    shown.add_column("held-out error, mrad", no_wrap=True)
    for head in ("given", *(map(title, results["scores"])), "floor"):
        shown.add_column(head, justify="right", no_wrap=True)
    for one in results["machines"]:
        errors = (one["before_rmse"], *one["after_rmse"].values(), one["repeat_rmse"])
        shown.add_row(one["name"], *("–" if e is None else f"{1e3 * e:.1f}" for e in errors))
    return shown


def title(who: str) -> str:
    """What a contender is called on a page."""
    return "wt diagnose" if who == OURS else who


def lines(results: Results) -> list[str]:
    """What is to be said beside the table."""
    found = []
    missed = [t for t in results["targets"] if t["met"] is False]
    for target in missed:
        wanted = f"{100 * target['from']:.0f} to {100 * target['to']:.0f} %"
        reached = f"{100 * target['reached']:.1f} %"
        found.append(f"missed: {LABELS[target['score']]} {reached}, wanted {wanted}")
    for who, scores in results["ahead"].items():
        behind = [LABELS[name] for name, better in scores.items() if better is False]
        if behind:
            found.append(f"behind {who}: {', '.join(behind)}")
    if results["code_changed"]:
        found.append("note: the code was changed while the trial ran")
    return found
