"""Pushes are read off a force with their own heights, times and flanks, and nothing else is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import ARM, scene
from wt.physics.effect import effects
from wt.physics.effects.force_intermittent import seen
from wt.physics.hooks import FromRecordings
from wt.physics.motion import Motion, Segment
from wt.physics.planted import Planted
from wt.physics.pushes import Push, pushes
from wt.physics.scene import Scene
from wt.physics.usual import SMOOTH_S
from wt.types import Location

J1 = Location("joint", "j1")
DT, SECONDS = 0.005, 10.0
GAUSSIANS = ((1.7, 0.05, 0.6), (4.0, 0.09, -0.4), (7.5, 0.03, 0.5))
"""Middle [s], deviation [s] and height of each."""


def motion(arm: Scene, recording: int = 0) -> Motion:
    n = round(SECONDS / DT)
    still = np.zeros((n, 3))
    segment = Segment(slice(0, n), recording, DT)
    return Motion(arm, (segment,), DT * np.arange(n), still, still, still, still)


def bumps(t: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    noise = 0.02 * rng.standard_normal(len(t)) + 0.01 * np.sin(1.3 * t)
    return noise + sum(h * np.exp(-0.5 * ((t - m) / s) ** 2) for m, s, h in GAUSSIANS)


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    return scene(tmp_path, ARM)


def test_each_push_has_its_own_height_time_and_length(arm: Scene) -> None:
    moved = motion(arm, 3)
    found = pushes(moved, bumps(moved.t), np.full(len(moved), 0.05))
    assert len(found) == len(GAUSSIANS)
    for push, (middle, deviation, height) in zip(found, GAUSSIANS, strict=True):
        assert push.recording == 3
        assert 0.5 * sum(push.window) == pytest.approx(middle, abs=0.01)
        impulse = push.height * np.trapezoid(push.course(moved.t), moved.t)
        assert impulse == pytest.approx(height * deviation * np.sqrt(2.0 * np.pi), rel=0.05)
        # a tenth of its height is left 2.15 deviations from the middle; what is shorter than the
        # bell by which forces are smoothed has its impulse rather than its height and length
        assert push.height == pytest.approx(height, rel=0.1 if deviation >= SMOOTH_S else 0.2)
        assert np.ptp(push.window) == pytest.approx(2 * 2.146 * deviation, rel=0.25)


@pytest.mark.parametrize("flank", [0.004, 0.3])
def test_a_window_ends_where_a_tenth_is_left(flank: float) -> None:
    push = Push(0, 1.0, 1.4, flank, 2.0)
    assert push.course(np.array([1.2, *push.window])) == pytest.approx([1.0, 0.1, 0.1])


def test_noise_and_what_never_rests_are_no_pushes(arm: Scene) -> None:
    moved = motion(arm)
    noise = np.random.default_rng(1).standard_normal(len(moved))
    # smoothed, it has a fifth of its deviation
    assert pushes(moved, noise, np.full(len(moved), 1.0)) == []
    friction = 0.1 * noise - 3.0 * np.sign(np.sin(5.0 * moved.t))
    assert pushes(moved, friction, np.full(len(moved), 0.5)) == []


def test_other_recordings_have_pushes_of_their_own(arm: Scene) -> None:
    effect = effects()["joint.force_intermittent"]
    assert isinstance(effect, FromRecordings)
    bound = effect.shaped((0.0, 1.0, 1.2, 0.02, 0.7))
    here = Planted(bound, J1, np.array([0.8]))
    there = motion(arm, 1)
    force = np.zeros_like(there.q)
    force[:, 1] = bumps(there.t)
    shown = here.elsewhere(there.without(there.residual - force))
    assert len(shown.theta) == shown.effect.n_theta == len(GAUSSIANS)
    assert shown.theta == pytest.approx([h for *_, h in GAUSSIANS], rel=0.2)
    both = here.beside(shown)
    assert both.theta[0] == 0.8
    assert both.observed()["recordings"] == ("-", (0.0, 1.0, 1.0, 1.0))
    nothing = here.elsewhere(there.without(there.residual))
    assert nothing.theta == pytest.approx([0.0]) and nothing.effect.n_theta == 1


def swinging(arm: Scene) -> Motion:
    """The middle joint to and fro, once in 1.6 s."""
    moved = motion(arm)
    w, t = 2.0 * np.pi / 1.6, moved.t
    q, v = 0.4 * np.sin(w * t), 0.4 * w * np.cos(w * t)
    q, v, a = (moved.on(1, column)[:, :, 0] for column in (q, v, -(w**2) * q))
    return replace(moved, q=q, v=v, a=a)


def seen_in(moved: Motion, force: np.ndarray) -> list[Push]:
    """Pushes on the middle joint where that force is left."""
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(moved))
    left = moved.on(1, force + noise)[:, :, 0]
    return seen(moved.without(moved.residual - left), J1)


def test_a_brake_that_drags_for_a_while_is_no_pushes(arm: Scene) -> None:
    moved = swinging(arm)
    t, toward = moved.t, np.sign(moved.v[:, 1])
    drags = (t > 3.4) & (t < 5.0)
    assert not seen_in(moved, -0.5 * toward * drags)
    # the same force now this way and now that, whichever way the joint moves
    shoved = 0.5 * np.sign(np.sin(2.0 * np.pi * (t - 3.4) / 1.6)) * drags
    assert len(seen_in(moved, shoved)) > 1
    # and with the motion, as somebody does who swings it
    assert len(seen_in(moved, 0.5 * toward * drags)) > 1
