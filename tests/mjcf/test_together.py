"""Effects that act together do so in the files as in the replays that they were found by."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tests.mjcf.written import drive, load, planted, unhidden, write
from tests.physics.arm import ARM, scene
from tests.physics.truths import TRUTHS
from wt.diagnose.selection.candidates import excluded
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

PLACES = {"j1", "m1", "b2", "all", "j1+j2"}
EVERY = list({p.key: p for p in map(planted, TRUTHS) if p.at.name in PLACES}.values())
"""Each effect that may be at one joint, its drive or its link, as in a test of its own."""
PAIRS = [pair for pair in itertools.permutations(EVERY, 2) if not excluded(*pair)]
SHORT_S = 0.5


def brief(one: Planted, other: Planted) -> bool:
    """Whether both are of the drive, which act on one another; in one order of the two."""
    of_drive = one.at.kind == other.at.kind == "actuator"
    return of_drive and EVERY.index(one) < EVERY.index(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [pytest.param(*pair, marks=[] if brief(*pair) else pytest.mark.long) for pair in PAIRS],
    ids=lambda p: f"{p.effect.id}-{p.at.name}",
)
def test_files_do_what_replays_do(one: Planted, other: Planted, tmp_path: Path) -> None:
    run = unhidden(ARM, SHORT_S)
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    both, *alone = Replayer(scene(tmp_path, ARM), [stretch]).run([[one, other], [one], [other]]).q
    files = drive(*load(write(tmp_path, [one, other])), run)
    least = min(np.sqrt(np.mean((both - q) ** 2)) for q in alone)
    assert np.sqrt(np.mean((files - both) ** 2)) < 0.1 * least + 1e-5
