"""Each effect against a machine that has it, which this repository's effects had no part in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import ARM, Run, coefficients, motion, scene, simulate
from tests.physics.truths import TRUTHS, Truth
from wt.physics.effect import effects
from wt.physics.hooks import shaped
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

KNOWN = pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: f"{t.id}-{t.at.name}")
_RUNS: dict[int, Run] = {}


def run_of(truth: Truth) -> Run:
    """The simulated recording, computed once."""
    if id(truth) not in _RUNS:
        _RUNS[id(truth)] = simulate(truth.xml or ARM, truth.hook() if truth.hook else None)
    return _RUNS[id(truth)]


@pytest.fixture(scope="module")
def nominal() -> Run:
    return simulate(ARM)


@KNOWN
def test_signature_recovers_the_parameters(truth: Truth, tmp_path: Path) -> None:
    effect = effects()[truth.id]
    moved = motion(scene(tmp_path), run_of(truth))
    if truth.fits is None:
        for shape in effect.shapes(moved, truth.at):
            assert effect.columns(moved, truth.at, shape).shape[:2] == moved.q.shape
        return
    shape = truth.shape or effect.shapes(moved, truth.at)[0]
    found, left = coefficients(moved, effect.columns(moved, truth.at, shape))
    theta = effect.theta(found, shape)
    assert theta == pytest.approx(np.array(truth.theta), rel=truth.fits, abs=truth.fits * 0.05)
    assert left < truth.leaves
    if truth.shape == truth.theta:
        assert found == pytest.approx(1.0, rel=truth.fits)
    for sign, value in zip(effect.signed, found, strict=False):
        assert sign * value >= 0.0


@KNOWN
def test_replay_follows_the_machine(truth: Truth, nominal: Run, tmp_path: Path) -> None:
    run = run_of(truth)
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    effect = shaped(effects()[truth.id], truth.shape)
    planted = Planted(effect, truth.at, np.array(truth.theta))
    replay = Replayer(scene(tmp_path), [stretch]).run([[planted]])
    influence = np.sqrt(np.mean((run.q - nominal.q) ** 2))
    error = np.sqrt(np.mean((replay.q[0] - run.q) ** 2))
    assert influence > 1e-4
    assert error < truth.replays * influence
