"""The concealed trials: build hidden worlds, diagnose them blind, and mark the answers.

Usage: python benchmarks/trials.py [--set quick|full|nulls|singles|pairs|outsiders] [--jobs N]
           [--seed S] [--only PATTERN] [--out FILE.json]

One line a case as it finishes, then a table. ``--only`` takes a part of a case's name, or a
pattern with ``*``. A diagnosis that fails with an error counts as wrong, and the error is shown.
"""

from __future__ import annotations

import argparse
import dataclasses
import fnmatch
import json
import multiprocessing
import os
import statistics
import tempfile
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, get_args

from wt.prove.cases import Case, SetName, cases
from wt.prove.score import CaseScore, score
from wt.prove.world import build

Result = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the trials; 0 when every diagnosis came back."""
    args = _arguments(argv)
    # before the workers start, so that numpy in them sees it
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
    pattern = args.only if "*" in args.only else f"*{args.only}*"
    chosen = [c for c in cases(args.set, args.seed) if fnmatch.fnmatch(c.name, pattern)]
    results: list[Result] = []
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(args.jobs, mp_context=spawn) as pool:
        for future in as_completed([pool.submit(run, case) for case in chosen]):
            results.append(future.result())
            print(line(results[-1], len(results), len(chosen)), flush=True)
            if args.out:
                _write(args.out, results)
    print(table(results))
    return 1 if any(r["error"] for r in results) else 0


def run(case: Case) -> Result:
    """Build, diagnose and mark one case; runs in a process of its own."""
    from wt.diagnose.pipeline import diagnose  # only here: the rest needs none of it

    start = time.perf_counter()
    world = build(case)
    built = time.perf_counter()
    result: Result = {
        "case": case.name,
        "kind": case.kind,
        "truth": [dataclasses.asdict(truth) for truth in case.truth],
        "noise_rms": max(world.noise_rms.values()),
        "diagnosis": None,
        "error": "",
    }
    marks = CaseScore(None, None, None, 0) if not case.truth else CaseScore(False, False, False, 0)
    try:
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder) / "robot.xml"
            model.write_text(world.nominal_xml)
            found = diagnose(model, list(world.fit), holdout=list(world.holdout)).to_json()
        result["diagnosis"] = found
        marks = score(found, case)
    except Exception:
        # one broken diagnosis must not end an hour of trials
        result["error"] = traceback.format_exc()
    result["score"] = dataclasses.asdict(marks)
    result["seconds"] = {"build": built - start, "diagnose": time.perf_counter() - built}
    return result


def line(result: Result, done: int, of: int) -> str:
    """One case on one line."""
    marks = result["score"]
    truth = ", ".join(f"{t['law']}@{t['name']}" for t in result["truth"]) or "nothing"
    if result["error"]:
        said = "ERROR " + result["error"].strip().splitlines()[-1][:100]
    else:
        findings = result["diagnosis"]["findings"]
        said = ", ".join(f"{f['effect']}@{f['at']['name']}" for f in findings) or "nothing"
    if result["kind"] == "null":
        flags = "ok" if not marks["false_claims"] and not result["error"] else "FALSE"
    else:
        flags = ("place " if marks["location"] else "----- ") + (
            "effect"
            if marks["effect"]
            else "(near)"
            if marks["effect_top_or_confusable"]
            else "-----"
        )
        flags += f" +{marks['false_claims']}" if marks["false_claims"] else ""
    error = max(marks["errors"].values(), default=float("nan"))
    return (
        f"[{done}/{of}] {result['case']}: {truth} | said {said} | {flags} | worst parameter "
        f"{error:.1%} | after/floor {marks['after']:.2f} | {result['seconds']['diagnose']:.0f} s"
    )


def table(results: Sequence[Result]) -> str:
    """Summary by kind of case."""
    head = f"{'kind':<10}{'cases':>6}{'location':>10}{'effect':>8}{'near':>7}{'extra':>7}"
    lines = ["", head + f"{'median error':>14}{'coverage':>10}{'after/floor':>13}{'seconds':>9}"]
    for kind in ("single", "pair", "triple", "outsider", "null", "all"):
        rows = [r for r in results if kind in (r["kind"], "all")]
        if rows:
            lines.append(_row(kind, rows))
    nulls = [r for r in results if r["kind"] == "null"]
    wrong = sum(r["score"]["false_claims"] > 0 for r in nulls)
    lines.append(f"\nfalse claims: {wrong} of {len(nulls)} cases with nothing hidden")
    broken = [r["case"] for r in results if r["error"]]
    if broken:
        lines.append(f"diagnoses that ended in an error: {', '.join(sorted(broken))}")
    return "\n".join(lines)


def _row(kind: str, rows: Sequence[Result]) -> str:
    marks = [r["score"] for r in rows]

    def share(name: str) -> str:
        flags = [m[name] for m in marks if m[name] is not None]
        return f"{sum(flags) / len(flags):.0%}" if flags else "–"

    errors = [e for m in marks for e in m["errors"].values()]
    covered = [c for m in marks for c in m["covered"].values()]
    after = [m["after"] for m in marks if m["after"] == m["after"]]
    extra = sum(m["false_claims"] for m in marks)
    seconds = statistics.median(r["seconds"]["diagnose"] for r in rows)
    return (
        f"{kind:<10}{len(rows):>6}{share('location'):>10}{share('effect'):>8}"
        f"{share('effect_top_or_confusable'):>7}{extra:>7}"
        f"{f'{statistics.median(errors):.2%}' if errors else '–':>14}"
        f"{f'{sum(covered) / len(covered):.0%}' if covered else '–':>10}"
        f"{f'{statistics.median(after):.2f}' if after else '–':>13}{seconds:>9.1f}"
    )


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--set", default="quick", choices=get_args(SetName))
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of a case's name, or a pattern")
    parser.add_argument("--out", type=Path, help="everything as JSON, rewritten after each case")
    return parser.parse_args(argv)


def _write(path: Path, results: Sequence[Result]) -> None:
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(list(results), indent=1, default=float))
    part.replace(path)


if __name__ == "__main__":
    raise SystemExit(main())
