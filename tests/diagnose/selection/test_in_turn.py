"""Effects that held-out recordings do not excite are proven on fitted ones left out in turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import NOISE, STEP, chain, record
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.refine import slopes_at, slopes_of
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.selection.holdout import Gain, Holdout, gain_of, gains, prepare_holdout
from wt.diagnose.selection.in_turn import left_in_turn, where_mute
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

ROTOR = Planted(effects()["joint.armature"], Location("joint", "j1"), np.array([0.05]))
RUBS = Planted(effects()["joint.friction_coulomb"], Location("joint", "j2"), np.array([0.01]))


MADE_BY = chain(2).replace('name="j1"', 'name="j1" armature=".05"')


def objective(folder: Path, recordings: int) -> Objective:
    """A chain of two with a rotor of .05 kg·m² in its first joint, and nothing else."""
    path = folder / "chain.xml"
    path.write_text(chain(2))
    parts = [Part(record(MADE_BY, None, 8.0 / recordings, i), i) for i in range(recordings)]
    fit = smooth(Scene(path), parts)
    return Objective(fit, stretches_of(fit, True), STEP, True)


@pytest.mark.parametrize("recordings", [1, 2])
def test_what_is_there_passes_and_what_is_not_does_not(tmp_path: Path, recordings: int) -> None:
    some = objective(tmp_path, recordings)
    now = some.reference((ROTOR, RUBS))
    slopes = slopes_of(now.hypothesis, slopes_at(some, now))
    real, imagined = (left_in_turn(some, now.hypothesis, i, slopes) for i in range(2))
    assert real.p_value < 1e-3
    assert real.share > 3 * THRESHOLDS.in_turn_share
    assert imagined.share < 0.3 * THRESHOLDS.in_turn_share


def test_too_few_blocks_to_be_sure_decide_nothing() -> None:
    """Of seven blocks the rank test is below .01 only if each of them gains."""
    all_but_the_least = Gain(0.99, 2 * 0.5**7, least_p=0.5**7)
    assert all_but_the_least.undecided
    assert not Gain(0.99, 0.5**7, least_p=0.5**7).undecided
    assert not Gain(0.3, 0.05, least_p=0.5**24).undecided


def test_a_single_effect_is_compared_with_none(tmp_path: Path) -> None:
    some = objective(tmp_path, 2)
    now = some.reference((ROTOR,))
    slopes = slopes_of(now.hypothesis, slopes_at(some, now))
    assert left_in_turn(some, now.hypothesis, 0, slopes).p_value < 1e-3


def held_out(some: Objective, swing: float) -> Holdout:
    """Another recording of the same chain."""
    parts = [Part(record(MADE_BY, None, 16.0, 7, swing), 0)]
    return prepare_holdout(smooth(some.scene, parts), True)


@pytest.mark.parametrize("swing", [0.0, 0.3])
def test_corrections_that_differ_do_not_speak_for_mute_data(tmp_path: Path, swing: float) -> None:
    some = objective(tmp_path, 2)
    now, held = some.reference((ROTOR,)), held_out(some, swing)
    # what stands in for the rotor in the fitted recordings moves all replays of the others
    load = Planted(
        effects()["body.payload_fixed"], Location("body", "link1"), np.array([0.05, 0.0, 0.0, -0.1])
    )
    (found,) = gains(held, now.hypothesis, [(load,)], STEP)
    found = Gain(-0.01, 0.5, found.potential)
    assert not found.undecided
    (settled,) = where_mute(some, held, now, now.hypothesis, [found], STEP)
    assert settled.in_turn == (swing == 0.0)
    assert (settled.p_value < 1e-3) == (swing == 0.0)


def test_the_rest_is_not_looked_at(tmp_path: Path) -> None:
    some = objective(tmp_path, 1)
    late = some.t > 4.0
    early = some.only(~late)
    assert not early.channels.valid[late].any()
    np.testing.assert_array_equal(early.channels.valid[~late], some.channels.valid[~late])
    np.testing.assert_allclose(early.count, 0.5 * some.count, rtol=0.1)
    (now,) = early.evaluate([()])
    assert not now.error[late].any()
    assert some.channels.valid[late].all()  # the whole keeps its own


def test_data_that_an_effect_leaves_as_they_are_are_mute() -> None:
    rng = np.random.default_rng(0)
    left, block = NOISE * rng.standard_normal((400, 2)), np.arange(400) // 10
    same = gain_of(left / NOISE, left / NOISE, (block, block))
    assert (same.share, same.p_value, same.potential) == (0.0, 1.0, 0.0)
    nudged = left + 0.05 * NOISE * np.sin(np.arange(400))[:, None]
    assert gain_of(nudged / NOISE, left / NOISE, (block, block)).potential < 0.01
    moved = left + 0.5 * NOISE * np.sin(np.arange(400))[:, None]
    assert gain_of(moved / NOISE, left / NOISE, (block, block)).potential > 0.05


@pytest.mark.parametrize(("share", "counts"), [(0.01, False), (0.05, True)])
def test_what_removes_next_to_nothing_is_no_gain_however_certain(
    share: float, counts: bool
) -> None:
    left, block = np.random.default_rng(0).standard_normal((20000, 2)), np.arange(20000) // 10
    worse = left * np.array([1.0, 1.0 / np.sqrt(1.0 - share)])
    found = gain_of(worse, left, (block, block))
    assert found.share == pytest.approx(0.5 * share, rel=0.1)
    assert (found.p_value < 1e-12) == counts
    assert counts or found.p_value == 1.0


def hit(blocks: int, better: bool = True) -> Gain:
    """Gain of what takes away an error in a few blocks, and adds a little to all others."""
    rng = np.random.default_rng(1)
    left, block = rng.standard_normal((400, 2)), np.arange(400) // 5
    touched = (block % 8 == 3) & (block < 8 * blocks)
    raw, patched = left + 30.0 * touched[:, None], 1.01 * left
    return gain_of(*((raw, patched) if better else (patched, raw)), (block, block))


def test_noise_elsewhere_does_not_outvote_hits() -> None:
    found = hit(10)
    assert found.share > 0.9 and found.p_value < 2e-3
    assert not found.undecided
    assert hit(10, better=False).p_value > 0.9


def test_too_few_hits_cannot_say() -> None:
    assert hit(4).share > 0.9 and hit(4).p_value == pytest.approx(0.5**4)
    assert hit(4).undecided
    assert not hit(4, better=False).undecided, "what makes replays worse is refused"


def test_what_costs_more_than_it_brings_is_no_gain() -> None:
    """Most blocks gain a little, and one joint much; a few that get worse lose more than that."""
    rng = np.random.default_rng(1)
    raw, block = rng.standard_normal((400, 2)), np.arange(400) // 5
    patched = raw * [0.9, 0.99]
    assert gain_of(raw, patched, (block, block)).p_value < 1e-3
    patched[:50] += [0.0, 3.0]
    worse = gain_of(raw, patched, (block, block))
    assert worse.share < 0.0 and worse.p_value == 1.0
