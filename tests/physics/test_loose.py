"""Loads that move inside a body: their paths and laws, against MuJoCo's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics import arm
from tests.physics.laws import G2, sliding
from wt.physics.effect import effects
from wt.physics.loose import LooseLaw, paths
from wt.physics.loose_search import laws_that_fit, likeliest_laws
from wt.physics.motion import Motion, Segment
from wt.types import Location

AT = (0.1, 0.04, 0.05)
RAILS = sliding(G2, "0.1 0.04 0.05", 0.05, 2.0, 0.0)


def recorded(folder: Path, xml: str, seconds: float) -> tuple[Motion, np.ndarray]:
    """What is recorded of the arm with a load on rails, and where the load is, (T,) [m]."""
    where: list[float] = []

    def watch(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        where.append(float(data.qpos[arm.JOINTS]))

    run = arm.simulate(xml, watch, seconds)
    return arm.motion(arm.scene(folder), run), np.array(where)


def test_the_path_is_that_of_the_load(tmp_path: Path) -> None:
    motion, truth = recorded(tmp_path, RAILS, 3.0)
    right, free = LooseLaw((0.1, 0.0, 0.0), 4.0, 0.0, 0.0), LooseLaw((0.2, 0.0, 0.0), 4.0, 0.0, 0.0)
    found, other = paths(motion, "b2", [(right, AT), (free, AT)])
    assert np.ptp(truth) > 0.07  # from one stop, and nearly to the other
    assert np.sqrt(np.mean((found.s[:, 0] - truth) ** 2)) < 0.002
    assert np.sqrt(np.mean((other.s[:, 0] - truth) ** 2)) > 0.02
    assert not found.s[:, 1:].any()


def test_recordings_and_pieces_side_by_side_are_each_alone(tmp_path: Path) -> None:
    motion, _ = recorded(tmp_path, RAILS, 8.0)
    whole, cut = motion.segments[0], 1500
    two = tuple(
        Segment(slice(*rows), whole.recording, whole.dt) for rows in ((0, cut), (cut, len(motion)))
    )
    laws = [LooseLaw((0.1, 0.0, 0.0), 4.0, 0.0, 0.0), LooseLaw((0.1, 0.1, 0.0), 2.0, 25.0, 0.4)]
    loads = [(law, AT) for law in laws]
    together = paths(replace(motion, segments=two), "b2", loads)
    alone = paths(motion, "b2", loads)
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_array_equal(one.s[:cut], other.s[:cut])
        assert not one.s[cut].any() and other.s[cut].any()
    for one, other in zip(paths(motion, "b2", loads, longest=3.0), alone, strict=True):
        assert np.abs(one.s - other.s).max() < 0.02 * np.abs(other.s).max()


@pytest.mark.long
def test_the_law_is_read_off_the_residual(tmp_path: Path) -> None:
    motion, _ = recorded(tmp_path, RAILS, 6.0)
    law, centre, mass = laws_that_fit(motion, "b2")[0]
    assert mass == pytest.approx(0.5, rel=0.05)
    assert law.travel[0] == pytest.approx(0.1, rel=0.05)
    assert max(law.travel[1:]) < 0.02
    assert law.damping == pytest.approx(4.0, rel=0.2)
    assert centre == pytest.approx(AT, abs=0.005)
    assert laws_that_fit(motion, "b0") == []


@pytest.mark.parametrize("seed", [0, 1])
def test_forces_too_noisy_to_place_a_load_still_say_how_it_moves(tmp_path: Path, seed: int) -> None:
    run = arm.simulate(RAILS, seconds=6.0)
    noise = 60.0 * np.random.default_rng(seed).normal(size=run.a.shape)
    noisy = arm.Run(run.t, run.held, run.q, run.v, run.a + noise)
    motion = arm.motion(arm.scene(tmp_path), noisy)
    first, *others = likeliest_laws(motion, "b2", AT)
    assert first.travel == (0.1, 0.0, 0.0)
    assert len(others) == 7
    # replays start where another effect has it
    moving, fixed = effects()["body.payload_moving"], np.array([0.4, *AT])
    starts = moving.beyond(motion, Location("body", "b2"), "body.payload_fixed", fixed)
    assert [theta[0] for _, theta in starts] == [0.4] * 8
    assert all(theta[2:] == pytest.approx(AT) for _, theta in starts)
    assert moving.shaped(starts[0][0]).observed()["shares"][1] == (1.0, 0.0, 0.0)
    assert moving.beyond(motion, Location("body", "b2"), "body.mass", np.array([1.1])) == []
