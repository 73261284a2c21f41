"""How long a diagnosis takes, and what it costs per second recorded.

Usage: python benchmarks/diagnose.py [--seconds 30 60] [--case arm6-joint.friction_coulomb]

Six joints at 200 Hz with one hidden effect; each line is a whole diagnosis, pictures included.
"""

from __future__ import annotations

import argparse
import dataclasses
import resource
import tempfile
import time
from pathlib import Path

from wt.diagnose.pipeline import diagnose
from wt.prove.cases import cases
from wt.prove.world import build


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, nargs="+", default=[30.0, 60.0])
    parser.add_argument("--case", default="arm6-joint.friction_coulomb")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    case = next(c for c in cases("full", args.seed) if args.case in c.name)
    sensing = dataclasses.replace(case.sensing, rate=200.0)
    print(f"{'fitted [s]':>10} {'time [s]':>10} {'per s':>8} {'memory [GB]':>12}  found")
    for seconds in args.seconds:
        # two recordings are fitted, one is held out
        world = build(dataclasses.replace(case, seconds=seconds / 2.0, sensing=sensing))
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder) / "robot.xml"
            model.write_text(world.nominal_xml)
            start = time.perf_counter()
            found = diagnose(model, world.fit, holdout=world.holdout)
            took = time.perf_counter() - start
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        said = ", ".join(f"{f.effect} at {f.at}" for f in found.findings) or "nothing"
        print(f"{seconds:10.0f} {took:10.1f} {took / seconds:8.2f} {memory:12.2f}  {said}")


if __name__ == "__main__":
    main()
