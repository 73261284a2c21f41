"""Effects that act together do so in the files as in the replays that they were found by."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tests.mjcf.written import drive, load, planted, unhidden, write
from tests.physics.arm import ARM, motion, scene
from tests.physics.truths import TRUTHS
from wt.diagnose.selection.candidates import excluded
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

PLACES = {"j1", "m1", "b2", "all", "j1+j2"}
ROUNDS = "sensor.quantization"  # by whole steps, wherever anything differs a little
FOUND = [p for p in map(planted, TRUTHS) if p.at.name in PLACES and p.effect.id != ROUNDS]
EVERY = list({p.key: p for p in FOUND}.values())
"""Each effect that may be at one joint, its drive or its link, as in a test of its own."""
PAIRS = [pair for pair in itertools.permutations(EVERY, 2) if not excluded(*pair)]
SHORT_S = 0.5


def brief(one: Planted, other: Planted) -> bool:
    """Whether both are of the drive, which act on one another; in one order of the two."""
    of_drive = one.at.kind == other.at.kind == "actuator"
    return of_drive and EVERY.index(one) < EVERY.index(other)


def size(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize(
    ("one", "other"),
    [pytest.param(*pair, marks=[] if brief(*pair) else pytest.mark.long) for pair in PAIRS],
    ids=lambda p: f"{p.effect.id}-{p.at.name}",
)
def test_files_do_what_replays_do(one: Planted, other: Planted, tmp_path: Path) -> None:
    run, of = unhidden(ARM, SHORT_S), scene(tmp_path, ARM)
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0], motion=motion(of, run))
    hypotheses = [one, other], [one], [other]
    both, *alone = Replayer(of, [stretch]).run(hypotheses).q
    files, *each = (drive(*load(write(tmp_path, h)), run) for h in hypotheses)
    least = min(size(both - q) for q in alone)
    near = sum(size(file - q) for file, q in zip(each, alone, strict=True))
    assert size(files - both) < 0.1 * least + 1.5 * near + 1e-5
