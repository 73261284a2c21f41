"""How long a diagnosis takes, beside ``mujoco.sysid``, which is told what to fit.

Usage: python benchmarks/diagnose.py [--case PART] [--seconds 30 60] [--seed S]    the long form
       python benchmarks/diagnose.py --seconds 10    the short one: half a minute

Six joints at 200 Hz with one hidden effect. First a whole diagnosis: it is told nothing, searches
every effect everywhere, and pictures count in its time. Then ``mujoco.sysid`` on the same two
recordings, free in the parameters of the hidden effect alone, with its own options and with ones
that make it faster; only its optimisation counts. All are judged on the same held-out recording:
RMSE of positions in one open-loop replay. ``ours /`` is our time, our error over theirs.

``--case`` is a part of a trial's name. sysid can be told of joint.friction_coulomb,
joint.friction_viscous, joint.armature, joint.stiffness and actuator.gain. Of a machine on legs
(``--case quadruped``) it fits nothing, and there is our row alone: it replays a recording open
loop from its start, and whoever walks that way falls.
"""

from __future__ import annotations

import argparse
import dataclasses
import resource
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wt.diagnose.pipeline import diagnose
from wt.errors import ConfigError, UserError, WorkError, suggest
from wt.prove.cases import Case, cases
from wt.prove.legged_rigs import Legged
from wt.prove.rigs import RIGS
from wt.prove.sysid_ranges import RANGES
from wt.prove.sysid_rival import TUNED, Rival
from wt.prove.world import HiddenWorld, build

CASE = "arm6-joint.friction_coulomb"
RATE_HZ = 200.0
ROW = "{:>10}  {:<12} {:>8} {:>7} {:>14} {:>7}  {}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; 0 if every diagnosis and fit came back."""
    args = _arguments(argv)
    try:
        case = chosen(args.case, args.seed)
        for truth in case.truth:
            values = _figures(truth.parameters)
            print(f"{case.name}: hidden {truth.effect} at {truth.name}, {values}")
        print(ROW.format("fitted [s]", "", "time [s]", "ours /", "held-out [rad]", "ours /", ""))
        for seconds in args.seconds:
            for cells in compared(case, seconds, args.seed):
                print(ROW.format(*cells), flush=True)
    except (UserError, WorkError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, UserError) else 1
    return 0


def chosen(part: str, seed: int) -> Case:
    """The first trial with that part in its name, recorded at 200 Hz.

    Of fixed machines those alone whose truth sysid can fit.

    Raises:
        ConfigError: there is none.
    """
    every = [c for c in cases("singles", seed) if c.truth[0].effect in RANGES]
    every += [c for c in cases("legged", seed) if c.truth and _walks(c)]
    case = next((c for c in every if part in c.name), None)
    if case is None:
        known = suggest(part, [c.name for c in every])
        raise ConfigError(f"{part!r} is in the name of no trial that can be timed; {known}")
    return dataclasses.replace(case, sensing=dataclasses.replace(case.sensing, rate=RATE_HZ))


def compared(case: Case, seconds: float, seed: int) -> list[tuple[str, ...]]:
    """Rows of ours, theirs and what lies around them, for so many seconds of fitted recordings."""
    # two recordings are fitted, one is held out
    world = build(dataclasses.replace(case, seconds=seconds / 2.0))
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "robot.xml"
        model.write_text(world.nominal_xml)
        start = time.perf_counter()
        found = diagnose(model, world.fit, holdout=world.holdout, seed=seed)
        ours = time.perf_counter() - start
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        error = found.proof.holdout
        told = [] if _walks(case) else _told(case, world, model, seed, (ours, error.after))
    said = "; ".join(
        f"{f.effect} at {f.at.name}, "
        + _figures({name: e.value for name, e in f.parameters.items()})
        for f in found.findings
    )
    after, before, noise = (f"{x:.6f}" for x in (error.after, error.before, error.noise_floor))
    return [
        (f"{seconds:.0f}", "wt diagnose", f"{ours:.1f}", "", after, "", said or "nothing"),
        *told,
        ("", "model", "", "", before, "", "as given"),
        ("", "noise", "", "", noise, "", f"our peak memory {memory:.2f} GB"),
    ]


def _told(
    case: Case, world: HiddenWorld, model: Path, seed: int, ours: tuple[float, float]
) -> list[tuple[str, ...]]:
    """Rows of sysid's, beside our time [s] and error [rad]."""
    rival = Rival(model, world.fit)
    told: list[tuple[str, ...]] = []
    ways: dict[str, Mapping[str, float]] = {"mujoco.sysid": {}, "… tuned": TUNED}
    for who, options in ways.items():
        fitted = rival.fit([(t.effect, t.name) for t in case.truth], seed, options=options)
        rmse = rival.prove(fitted, world.holdout, seed).holdout.after
        values = "; ".join(_figures(p.effect.named(p.theta)) for p in fitted.hypothesis)
        ratios = f"{ours[0] / fitted.seconds:.1f}", f"{ours[1] / rmse:.3f}"
        told.append(("", who, f"{fitted.seconds:.1f}", ratios[0], f"{rmse:.6f}", ratios[1], values))
    return told


def _walks(case: Case) -> bool:
    return isinstance(RIGS[case.rig], Legged)


def _figures(parameters: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name} " + " ".join(f"{x:.4g}" for x in np.atleast_1d(value))
        for name, value in parameters.items()
    )


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--case", default=CASE, help="part of a trial's name")
    parser.add_argument("--seconds", type=float, nargs="+", default=[30.0, 60.0], help="fitted")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args(argv)


if __name__ == "__main__":
    raise SystemExit(main())
