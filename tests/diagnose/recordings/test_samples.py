"""Missing samples: what was commanded meanwhile still counts, and no clock is thrown off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import scene
from wt.diagnose.recordings.samples import LONG_GAP, Part, samples_of, stamps
from wt.types import Recording


def recording(folder: Path, lost: slice) -> Part:
    """A recording of the test arm that lost the positions of some samples."""
    t = np.arange(0.0, 4.0, 0.01)
    machine = scene(folder)
    columns = {f"qpos/{j}": 0.3 * np.sin(t + k) for k, j in enumerate(machine.joints)}
    for column in columns.values():
        column[lost] = np.nan
    for i in range(machine.model.nactuator):
        columns[f"ctrl/{machine.model.actuator(i).name}"] = np.sin(3.0 * t + i)
    return Part(Recording(t, columns, {}), 0)


def test_a_lost_sample_keeps_its_command(tmp_path: Path) -> None:
    part = recording(tmp_path, slice(200, 203))
    (found,) = samples_of(scene(tmp_path), [part])
    assert len(found.t) == 400
    assert np.isnan(found.q[200:203]).all() and np.isfinite(found.command).all()
    assert found.command[201, 0] == np.sin(3.0 * found.t[201])


def test_a_long_gap_ends_a_segment(tmp_path: Path) -> None:
    gap = int(LONG_GAP / 0.01) + 3
    first, second = samples_of(scene(tmp_path), [recording(tmp_path, slice(200, 200 + gap))])
    assert len(first.t) == 200
    assert second.t[0] == first.t[-1] + 0.01 * (gap + 1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("jitter", [0.01, 0.06, 0.15])
def test_stamps_that_err_over_dropped_samples_give_back_the_even_clock(
    jitter: float, seed: int
) -> None:
    rng, dt = np.random.default_rng(seed), 0.01
    kept = np.flatnonzero(rng.random(1600) > 0.01)
    true = dt * (kept - kept[0])
    read = true + jitter * dt * np.clip(rng.normal(size=len(kept)), -3.0, 3.0)
    position = np.sin(2.0 * np.pi * true) + 1e-4 * rng.normal(size=len(true))
    found = stamps(Recording(read, {"qpos/q1": position, "ctrl/q1": position}, {}))
    # up to where the first stamp happened to be; half an interval off is what a wrong gap makes
    assert np.ptp(found - true) < 0.05 * dt


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("stamped", [True, False])
def test_jolts_tell_nothing_of_a_clock(stamped: bool, seed: int) -> None:
    """The loop ran unevenly, or its stamps err: samples are smooth by the right clock."""
    rng, dt = np.random.default_rng(seed), 0.02
    even = dt * np.arange(800)
    uneven = even + 0.02 * dt * rng.normal(size=len(even))
    uneven -= uneven[0]
    true = uneven if stamped else even
    jolts = np.cumsum(0.3 * rng.normal(size=40))[(true / 0.4).astype(int)]
    position = jolts + np.sin(2.0 * true) + 1e-4 * rng.normal(size=len(true))
    found = stamps(Recording(uneven, {"qpos/q1": position, "ctrl/q1": position}, {}))
    assert np.std(found - true) < 0.005 * dt
