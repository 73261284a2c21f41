"""The runner's regularity on a simulated Go2, without a passport and with one, turn by turn.

A first walk is the passport's only session. Then each turn walks once without it and once with it;
runner, simulated robot and the process that compares them share the cores that there are.

Usage: python benchmarks/watched.py [TURNS [SECONDS [--realtime]]]
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from runner import WALK, run, simulate

from wt.data.labels import Labels
from wt.passport.folder import Addition, Source, append, locked
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

FRICTION = 0.2  # N·m, that the passport knows of one knee
UNIT = "A17"


def main(turns: int = 3, seconds: float = 32.0, *options: str) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        walk(folder / "first", seconds, options)
        passport(folder / "passport", folder / "first" / "run")
        watched = "--passport", str(folder / "passport"), "--unit", UNIT
        print(f"{'[ms]':<24}{'jitter p50':>12}{'p99':>9}{'max':>9}{'judged':>8}")
        rows: dict[str, list[float]] = {}
        for turn in range(turns):
            for what, words in (("without", ()), ("with", watched)):
                out = folder / f"{what}-{turn}"
                jitter = walk(out, seconds, options, *words)
                judged = out / "run" / "drift.json"
                count = len(json.loads(judged.read_text())["judgements"]) if judged.exists() else 0
                rows.setdefault(what, []).append(jitter["p99"])
                print(f"{f'{what} a passport':<24}{jitter['p50']:>12.3f}{jitter['p99']:>9.3f}"
                      f"{jitter['max']:>9.3f}{count:>8}", flush=True)  # fmt: skip
        print(", ".join(f"{what}: p99 {np.median(p):.3f} ms" for what, p in rows.items()))


def walk(folder: Path, seconds: float, options: tuple[str, ...], *words: str) -> dict[str, float]:
    """Stand up, walk and turn back as long as there is time; the loop's jitter [ms]."""
    *begin, stop, _ = WALK
    script = [*begin, f"{seconds - 2:g}:{stop.partition(':')[2]}", f"{seconds - 1:g}:damping"]
    sim = simulate(folder, options, *script, seconds=seconds + 40.0)
    said = run(folder, options, "--seconds", f"{seconds:g}", *words).communicate()
    sim.terminate()
    sim.communicate()
    report = folder / "run" / "report.json"
    if not report.exists():
        sys.exit(f"no report: {said}")
    jitter: dict[str, float] = json.loads(report.read_text())["timing"]["jitter"]
    return jitter


def passport(folder: Path, run_folder: Path) -> None:
    """A passport whose only session is a run."""
    model, recording = run_folder / "model.xml", run_folder / "recording.parquet"
    labels = Labels(UNIT, "2026-11-01")
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (model, recording)]
    knee = Location("joint", "FL_calf_joint")
    known = Planted(effects()["joint.friction_coulomb"], knee, np.array([FRICTION]))
    first = Addition(
        model=str(model),
        model_sha256=digests[0],
        made="2026-11-01T10:00:00+00:00",
        sources=(Source(str(recording), digests[1], labels),),
        hypothesis=(known,),
        rows=(),
        decided={"levels": [], "alarms": [], **asdict(labels)},
    )
    with locked(folder):
        append(folder, first)


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if not word.startswith("-")]
    flags = [word for word in sys.argv[1:] if word.startswith("-")]
    main(*(int(given[0]),) if given else (), *(float(x) for x in given[1:2]), *flags)
