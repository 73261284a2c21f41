"""Machines that nothing holds: what the feet may supply is not blamed, what is missing is named."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import mujoco
import numpy as np
import pytest

from tests.physics import stool
from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import FLOATING_S, forgets, stretches_of
from wt.diagnose.residual.screen import Scored, Screen
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.scene import Scene
from wt.types import Location


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return stool.scene(tmp_path_factory.mktemp("stool"))


def ranked(machine: Scene, edit: stool.Edit | None, seconds: float) -> list[Scored]:
    parts = [Part(stool.recording(seed, edit, seconds), seed) for seed in (3, 4)]
    return Screen(smooth(machine, parts)).rank([])


def test_it_is_replayed_in_short_pieces(machine: Scene) -> None:
    smoothed = smooth(machine, [Part(stool.recording(0, seconds=3.0), 0)])
    assert not forgets(smoothed, 1e-3)
    pieces = stretches_of(smoothed, False)
    assert all(s.t[-1] - s.t[0] < FLOATING_S + 0.02 for s, _ in pieces)


def shoved(t: float) -> Sequence[float]:
    """A shove between pieces that are spread evenly."""
    return (3.0, -4.0, 2.0) if 2.4 <= t < 2.6 else (0.0, 0.0, 0.0)


def test_some_pieces_are_where_forces_are_unusual(machine: Scene) -> None:
    smoothed = smooth(machine, [Part(stool.recording(3, seconds=5.0, push=shoved), 0)])
    even, some = (stretches_of(smoothed, False, 2.0, share) for share in (0.0, 0.5))
    assert len(even) == len(some)

    def during(pieces: list[tuple[Stretch, np.ndarray]]) -> float:
        t = np.concatenate([s.t for s, _ in pieces])
        return float(((t >= 2.4) & (t < 2.6)).sum() * 0.01)

    assert during(even) < 0.1 < 0.19 < during(some)
    ends = [(s.t[0], s.t[-1]) for s, _ in some]
    assert all(end < start for (_, end), (start, _) in itertools.pairwise(ends))


@pytest.mark.long
def test_where_nothing_is_hidden_little_is_gained(machine: Scene) -> None:
    assert ranked(machine, None, 6.0)[0].gain < 12.0


@pytest.mark.parametrize(
    "at", [(0.08, -0.03, 0.06), pytest.param((0.12, -0.05, 0.15), marks=pytest.mark.long)]
)
def test_a_load_on_the_trunk_leads_wherever_it_sits(
    machine: Scene, at: tuple[float, float, float]
) -> None:
    best = ranked(machine, stool.loaded(1.0, at), 4.0)[0]
    assert (best.planted.effect.id, best.planted.at.name) == ("body.payload_fixed", "trunk")
    assert best.gain > 200.0
    # linear around the trunk's centre of mass alone, the first weighs 0.72 kg
    assert best.planted.theta == pytest.approx(np.array([1.0, *at]), rel=0.08, abs=0.005)


@pytest.mark.long
def test_friction_of_a_leg_leads(machine: Scene) -> None:
    best = ranked(machine, stool.stiff("rear_hip", 0.6), 4.0)[0]
    assert best.planted.at.name == "rear_hip" and best.planted.effect.id.startswith(
        "joint.friction"
    )
    assert best.planted.theta[0] == pytest.approx(0.6, rel=0.25)


PUSH, WINDOWS = (3.0, -4.0, 2.0), ((1.2, 1.7), (3.1, 3.5))


def pushed(t: float) -> Sequence[float]:
    """A push that is a tenth of the weight, now and then."""
    return PUSH if any(start <= t < end for start, end in WINDOWS) else (0.0, 0.0, 0.0)


@pytest.mark.long
def test_a_push_that_is_fainter_than_the_residual_is_seen_by_its_direction(machine: Scene) -> None:
    parts = [Part(stool.recording(seed, seconds=5.0, push=pushed), seed) for seed in (3, 4)]
    screen = Screen(smooth(machine, parts))
    best = screen.rank([])[0]
    assert (best.planted.effect.id, best.planted.at.name) == ("body.force_intermittent", "trunk")
    assert best.planted.theta == pytest.approx(np.array(PUSH), rel=0.15)
    t = np.arange(0.0, 5.0, 0.01)
    true = np.array([any(pushed(x)) for x in t])
    for recording in (3.0, 4.0):
        said = np.zeros(len(t), dtype=bool)
        for which, start, end in np.array(best.shape).reshape(-1, 3):
            said |= (which == recording) & (start <= t) & (t < end)
        assert (said == true).mean() > 0.92


PULL = (1.5, -1.0, 2.0)


def heavier_and_stronger(spec: mujoco.MjSpec) -> None:
    """A trunk of 3 % more mass, drives of 1 % more gain: no more than any rig is off by."""
    trunk = next(g for g in spec.geoms if g.name == "trunk")
    trunk.mass *= 1.03
    for drive in spec.actuators:
        drive.gainprm[0] *= 1.01
        drive.biasprm[1] *= 1.01


@pytest.mark.long
def test_a_pull_upwards_is_told_no_better_than_weights_and_drives_are_known(
    machine: Scene,
) -> None:
    recorded = [
        stool.recording(seed, heavier_and_stronger, seconds=5.0, push=lambda t: PULL)
        for seed in (1, 2)
    ]
    fit = smooth(machine, [Part(r, seed) for seed, r in enumerate(recorded)])
    objective = Objective(fit, stretches_of(fit, False), 2e-3, False)
    start = Planted(effects()["body.force"], Location("body", "trunk"), np.array(PULL))
    (found,) = estimate(objective, (start,)).estimates
    low, high = (np.array(end) for end in found["force"].ci95)
    assert ((low < PULL) & (high > PULL)).all()
    half = 0.5 * (high - low)
    assert half[2] > 0.2, "0.07 N is what noise alone would make of it"
    assert (half[:2] < 0.7 * half[2]).all()


def test_moments_of_a_blow_are_not_calm(machine: Scene) -> None:
    motion = smooth(machine, [Part(stool.recording(3, seconds=4.0), 0)]).motion
    before = motion.calm
    assert before.mean() > 0.7
    force = np.zeros_like(motion.q)
    blow = slice(200, 202)
    force[blow, 6:] = 20.0 * np.std(motion.unexplained[:, 6:], axis=0)
    calm = motion.without(force).calm
    assert not calm[blow].any()
    far = np.abs(np.arange(len(calm)) - 201) > 10
    assert (calm | ~before)[far].all(), "a blow makes no other moment a worse one"
