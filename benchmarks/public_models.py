"""Public robot models: hide one thing in each, diagnose, and mark the answers.

Usage: python benchmarks/public_models.py FOLDER [--only ROBOT/CASE] [--list] [--jobs N] [--seed S]
           [--out FILE.jsonl]
       python benchmarks/public_models.py --table FILE.jsonl ...

FOLDER has one folder a robot, NAME/NAME.xml with its meshes, as others publish them: arms, hands,
legs, carts. Free joints are taken out, so that legs hang from a held base. Every robot is recorded
three times for 10 s at about 100 Hz, with 0.1 mrad of encoder noise, and the third recording is
held out. What is hidden is written with MjSpec and stepped by plain MuJoCo, so finely that half the
step would change nothing beyond a fifth of the noise:

    nothing
    friction  dry, of 3 to 8 % of the most that one drive can do
    payload   at the body at the end of a chain, 5 to 30 % of what the drives hold there
    gain      of one drive, 0.6 to 0.8 times what it is
    delay     of all commands, 10 to 20 ms in whole steps

It is drawn again until it changes some joint by five times the noise and leaves none stuck, from
half of the draws on twice as strong; where that never is, the case is "unseen" and not counted.
Drives that hold positions get sums of slow sines, others torques of a soft controller around what
holds the pose. Motions stay within 0.3 rad of the first keyframe (one named home, if there is one),
inside all ranges, and get smaller until nothing touches that does not touch at rest and no drive is
at its limit.

Right is one finding, of the hidden effect at the hidden place, a drive being where its joint is.
For a load that is fixed to a link, that link's mass or centre of mass says the same. "near" names
the hidden effect among what the finding may be confused with.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import multiprocessing
import os
import tempfile
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

from public_robots import CASES, Robot, held, motions, settled, visible

from wt.errors import UserError
from wt.prove.case import HiddenEffect
from wt.prove.machine import of_model
from wt.prove.score import CaseScore, mark
from wt.train.replicas import end_with_parent
from wt.types import Recording

Result = dict[str, Any]

ALSO_RIGHT = {"body.payload_fixed": ("body.mass", "body.com")}


def run(path: Path, case: str, seed: int) -> Result:
    """Record, diagnose and mark one case; runs in a process of its own."""
    began = time.perf_counter()
    result: Result = {"robot": path.stem, "case": case, "seed": seed, "mark": "ERROR", "error": ""}
    with tempfile.TemporaryDirectory() as scratch:
        try:
            given = held(path, Path(scratch))
            made = settled(motions(Robot(given), seed))
            robot = made[0].robot
            result["step"] = robot.step
            hidden = visible(robot, made, case, seed)
            if hidden is None:
                return result | {"mark": "unseen", "seconds": time.perf_counter() - began}
            recordings = [motion.run(hidden)[0] for motion in made]
            result["sizes"] = [round(motion.size, 3) for motion in made]
            truth = hidden.truth
            if truth:
                result["truth"] = f"{truth.effect}@{truth.name}"
                result["parameters"] = dict(truth.parameters)
            result["built_s"] = time.perf_counter() - began
            result |= _diagnosed(given, recordings, truth)
        except Exception as error:
            # one that breaks must not end hours of others
            result["mark"] = "refused" if isinstance(error, UserError) else "ERROR"
            result["error"] = str(error) if isinstance(error, UserError) else traceback.format_exc()
    return result | {"seconds": time.perf_counter() - began}


def _diagnosed(given: Path, recordings: Sequence[Recording], truth: HiddenEffect | None) -> Result:
    from wt.diagnose.pipeline import diagnose  # only here: --list and --table need none of it

    found = diagnose(given, recordings[:-1], recordings[-1:]).to_json()
    effects = ("", *ALSO_RIGHT.get(truth.effect, ())) if truth else ("",)
    marks = [
        mark(found, [replace(truth, effect=e or truth.effect)] if truth else [], of_model(given))
        for e in effects
    ]
    best = max(marks, key=lambda m: (bool(m.effect), bool(m.effect_top_or_confusable)))
    return {
        "mark": _word(best, truth is None),
        "verdict": found["verdict"],
        "said": [
            {k: f.get(k) for k in ("effect", "at", "parameters", "evidence", "confusable_with")}
            for f in found["findings"]
        ],
        "notes": found.get("notes", []),
        "errors": dict(best.errors),
        "holdout": found["fit"]["holdout"],
    }


def _word(marks: CaseScore, null: bool) -> str:
    if null:
        return "false" if marks.false_claims else "right"
    word = "right" if marks.effect else "near" if marks.effect_top_or_confusable else "place"
    word = word if marks.location else "missed"
    return f"{word}+{marks.false_claims}" if marks.false_claims else word


def line(result: Result) -> str:
    """One case on one line."""
    said = ", ".join(f"{f['effect']}@{f['at']['name']}" for f in result.get("said", []))
    if result["error"]:
        said = result["error"].strip().splitlines()[-1][:160]
    errors = ", ".join(
        f"{k.rpartition('.')[2]} {e:.1%}" for k, e in result.get("errors", {}).items()
    )
    case = f"{result['mark']:<9} {result['robot']}/{result['case']}"
    return (
        f"{case}: {result.get('truth', 'nothing')} | "
        f"{result.get('verdict', '–')}: {said or 'nothing'} | off by {errors or '–'} | "
        f"{result['seconds'] / 60.0:.1f} min"
    )


def table(results: Sequence[Result]) -> str:
    """Marks of all robots and cases, with minutes."""
    names = sorted({r["robot"] for r in results})
    cell = {(r["robot"], r["case"]): f"{r['mark']} {r['seconds'] / 60.0:.0f}'" for r in results}
    lines = ["", f"{'robot':<14}" + "".join(f"{case:>14}" for case in CASES)]
    lines += [
        f"{name:<14}" + "".join(f"{cell.get((name, case), '·'):>14}" for case in CASES)
        for name in names
    ]
    results = [r for r in results if r["mark"] != "unseen"]
    right = {c: [r["mark"] == "right" for r in results if r["case"] == c] for c in CASES}
    lines.append(f"{'right':<14}" + "".join(f"{f'{sum(x)}/{len(x)}':>14}" for x in right.values()))
    every = [r["mark"] for r in results]
    counted = [f"{sum(w in m for m in every)} {w}" for w in ("near", "refused", "ERROR")]
    lines.append(f"\n{every.count('right')} of {len(every)} right; {', '.join(counted)}")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the cases; 0 when every diagnosis came back."""
    args = _arguments(argv)
    if args.table:
        lines = [row for file in args.table for row in file.read_text().splitlines()]
        print(table([json.loads(row) for row in lines]))
        return 0
    # before the workers start, so that numpy in them sees it
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
    paths = sorted(p for p in args.folder.glob("*/*.xml") if p.stem == p.parent.name)
    wanted = args.only if "/" in args.only else f"{args.only or '*'}/*"
    chosen = [(p, c) for p in paths for c in CASES if fnmatch.fnmatch(f"{p.stem}/{c}", wanted)]
    if args.list:
        print("\n".join(f"{path.stem}/{case}" for path, case in chosen))
        return 0
    results: list[Result] = []
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(args.jobs, spawn, initializer=end_with_parent) as pool:
        for future in as_completed([pool.submit(run, p, c, args.seed) for p, c in chosen]):
            results.append(future.result())
            print(f"[{len(results)}/{len(chosen)}] {line(results[-1])}", flush=True)
            if args.out:
                with args.out.open("a") as file:
                    file.write(json.dumps(results[-1], default=float) + "\n")
    print(table(results))
    return 1 if any(r["error"] for r in results) else 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, help="of robots, NAME/NAME.xml each")
    parser.add_argument("--only", default="", help="robot, or robot/case; may have *")
    parser.add_argument("--list", action="store_true", help="name the cases and run none")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0, help="of motions and of what is hidden")
    parser.add_argument("--out", type=Path, help="a line of JSON is added for every case")
    parser.add_argument("--table", nargs="+", type=Path, help="print the table of such files")
    args = parser.parse_args(argv)
    if (args.folder is None) == (args.table is None):
        parser.error("give either the FOLDER of robots or --table with files of results")
    return args


if __name__ == "__main__":
    raise SystemExit(main())
