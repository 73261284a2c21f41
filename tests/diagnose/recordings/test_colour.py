"""Noise whose neighbouring samples are alike is told from white noise, and states are as unsure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.diagnose.recordings.test_stretches import CHAIN, steps
from wt.diagnose.recordings.colour import (
    Noise,
    alike,
    autoregressive,
    colour_of,
    deviation_of,
    slowest,
)
from wt.diagnose.recordings.curves import choose, fit
from wt.diagnose.recordings.samples import Part, Samples
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.residual.screen import Screen
from wt.physics.scene import Scene
from wt.types import Recording

SIZE, FINE = 1e-3, 500


def coloured(count: int, colour: float, seed: int, columns: int = 1) -> np.ndarray:
    """Noise of first order, by a filter that has settled."""
    white = np.random.default_rng(seed).standard_normal((count + 300, columns))
    return SIZE * lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white, axis=0)[300:]


def sampled(q: np.ndarray, rate: int = FINE) -> Samples:
    none = np.zeros((len(q), 0))
    return Samples(0, np.arange(len(q)) / rate, q, np.full_like(q, np.nan), none, none)


@pytest.mark.parametrize("colour", [0.0, 0.4, 0.7, 0.85])
@pytest.mark.parametrize("spacing", [4.0, 8.0, 24.0])
def test_what_a_curve_leaves_tells_the_noise(colour: float, spacing: float) -> None:
    noise = coloured(8000, colour, 1)
    curve = fit(sampled(noise), 0, spacing, 1.0, np.nan)
    assert curve.alike < colour or not colour
    found = colour_of(curve.alike, spacing, len(noise))
    assert found == pytest.approx(colour, abs=0.08)
    assert deviation_of(curve.sigma, spacing, found) == pytest.approx(SIZE, rel=0.15)


@pytest.mark.parametrize("colour", [0.0, 0.5, 0.75])
def test_a_curve_follows_a_motion_and_not_coloured_noise(colour: float) -> None:
    t = np.arange(6000) / FINE
    motion = 0.4 * np.sin(3.0 * t) + 0.1 * np.sin(9.0 * t)
    curve = choose(sampled(motion[:, None] + coloured(len(t), colour, 2)), 0)
    assert curve.colour == pytest.approx(colour, abs=0.08)
    assert curve.sigma == pytest.approx(SIZE, rel=0.15)
    speed = 1.2 * np.cos(3.0 * t) + 0.9 * np.cos(9.0 * t)
    off = (curve.at(t, 1) - speed)[100:-100]
    assert np.sqrt(np.mean(off**2)) < 0.05


def test_a_fast_motion_is_no_noise() -> None:
    """What few knots miss is alike, and is not taken for noise."""
    t = np.arange(6000) / FINE
    motion = 0.02 * np.sin(2.0 * np.pi * 22.0 * t)
    curve = choose(sampled(motion[:, None] + coloured(len(t), 0.0, 3)), 0)
    assert not curve.colour
    assert curve.sigma == pytest.approx(SIZE, rel=0.1)
    off = (curve.at(t, 0) - motion)[100:-100]
    assert np.sqrt(np.mean(off**2)) < 0.8 * SIZE


def test_what_few_knots_miss_is_told_from_noise_step_by_step() -> None:
    """Scores and correlations of noise of .6 beside a motion that 24 samples a knot miss."""
    spacings = [3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0]
    scores = [1.00, 1.02, 1.07, 1.15, 1.39, 1.65, 3.26]
    alikes = [-0.28, -0.08, 0.12, 0.24, 0.42, 0.52, 0.76]
    found = slowest(scores, alikes, spacings, 7000)
    assert found is not None
    assert spacings[found[0]] <= 16.0
    assert found[1] == pytest.approx(0.6, abs=0.1)
    white = [-np.sin(np.pi / s) / (np.pi - np.pi / s) for s in spacings]
    assert slowest(scores, white, spacings, 7000) is None


def test_what_finer_curves_leave_white_is_no_noise() -> None:
    """Scores and correlations of a real pendulum, which 24 samples a knot miss now and then."""
    spacings = [1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0]
    deviations = np.array([3.01, 2.50, 2.24, 2.15, 2.12, 2.14, 2.30, 2.74, 4.25])
    alikes = [-0.82, -0.61, -0.35, -0.21, -0.05, 0.05, 0.24, 0.47, 0.79]
    assert slowest(list(deviations**2), alikes, spacings, 4999) is None


def test_few_samples_a_knot_tell_no_colour() -> None:
    """Of a slow log nobody knows whether what its curves leave is noise or motion."""
    t = np.arange(1200) / 100.0
    motion = 0.3 * np.sin(2.0 * t)
    assert not choose(sampled(motion[:, None] + coloured(len(t), 0.7, 4), 100), 0).colour


def recorded(folder: Path, colour: float) -> tuple[Smoothed, np.ndarray]:
    """A smooth motion of a chain with such noise, and its true speed."""
    clean, speed = steps(0.0, noise=0.0, rate=FINE)
    noise = coloured(len(clean.t), colour, 1, 2)
    columns = {k: x.copy() for k, x in clean.columns.items()}
    for i in range(2):
        columns[f"qpos/j{i + 1}"] += noise[:, i]
    path = folder / "chain.xml"
    path.write_text(CHAIN)
    return smooth(Scene(path), [Part(Recording(clean.t, columns), 0)]), speed


@pytest.mark.parametrize("colour", [0.0, 0.5, 0.8])
def test_states_are_as_unsure_as_coloured_noise_makes_them(tmp_path: Path, colour: float) -> None:
    smoothed, speed = recorded(tmp_path, colour)
    assert smoothed.colour == pytest.approx([colour] * 2, abs=0.1)
    assert smoothed.noise == pytest.approx([SIZE] * 2, rel=0.2)
    (_, v, _), unsure = smoothed.at_samples[0], smoothed.unsure[0][2:]
    inner = slice(FINE // 2, -FINE // 2)
    off = (v - speed)[inner] / unsure
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.6


def test_forces_are_told_from_coloured_noise(tmp_path: Path) -> None:
    white, other = (recorded(tmp_path, colour)[0] for colour in (0.0, 0.8))
    floors = [Screen(smoothed, 0).floor for smoothed in (white, other)]
    assert (floors[1] > 1.5 * floors[0]).all()


def test_noise_has_the_size_and_colour_that_it_is_asked_for() -> None:
    noise = Noise(np.array([2.0, 3.0]), np.array([0.0, 0.7]), np.full(2, np.nan))
    q, v = noise.drawn(20_000, np.random.default_rng(0))
    assert q.std(axis=0) == pytest.approx([2.0, 3.0], rel=0.03)
    assert alike(q[:, 0]) == pytest.approx(0.0, abs=0.03)
    assert alike(q[:, 1]) == pytest.approx(0.7, abs=0.03)
    assert not v.any()
    white = np.random.default_rng(1).standard_normal((50, 2))
    np.testing.assert_array_equal(autoregressive(white, np.zeros(2)), white)
