"""Stamps that jitter are told from samples that were taken unevenly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.check.machines import record
from wt.check.run import check
from wt.types import Recording


@pytest.mark.parametrize("share", [0.4, 0.6, 0.95])
def test_samples_that_were_stamped_late_are_stamped_anew(share: float) -> None:
    clean = record("arm4", 50, seconds=6.0)
    late = np.random.default_rng(1).uniform(0.0, share * 0.01, len(clean))
    checked = check(None, replace(clean, t=clean.t + late))
    (found,) = checked.findings
    assert (found.kind, found.columns) == ("clock_jitter", ("t",))
    assert checked.recording is not None
    away = checked.recording.t - clean.t
    assert away.std() < 2e-4
    assert away.mean() == pytest.approx(share * 0.005, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_lost_rows_are_no_uneven_pace(seed: int) -> None:
    clean, rng = record("arm4", 53, seconds=6.0, rate=50.0), np.random.default_rng(seed)
    kept = rng.random(len(clean)) > 0.02
    t = clean.t + np.clip(0.06 * rng.standard_normal(len(clean)), -0.2, 0.2) * 0.02
    columns = {name: column[kept] for name, column in clean.columns.items()}
    assert not check(None, Recording(t[kept], columns)).findings


@pytest.mark.parametrize("seed", range(3))
def test_late_stamps_stay_where_lost_rows_hide_the_pace(seed: int) -> None:
    clean, rng = record("arm4", 54, seconds=6.0), np.random.default_rng(seed)
    kept = rng.random(len(clean)) > 0.02
    late = rng.uniform(0.0, 0.6 * 0.01, len(clean))
    columns = {name: column[kept] for name, column in clean.columns.items()}
    given = Recording((clean.t + late)[kept], columns)
    checked = check(None, given)
    assert checked.recording is None or np.array_equal(checked.recording.t, given.t)


@pytest.mark.parametrize("share", [0.3, 0.95])
def test_samples_that_were_taken_unevenly_are_right(share: float) -> None:
    clean = record("arm4", 51, seconds=6.0, rate=500.0)
    t = np.arange(0.0, clean.t[-1] - 0.02, 0.01)
    t += np.random.default_rng(2).uniform(0.0, share * 0.0099, len(t))
    uneven = {name: np.interp(t, clean.t, column) for name, column in clean.columns.items()}
    assert not check(None, Recording(t, uneven)).findings


@pytest.mark.parametrize(("noise", "jitter"), [(0.05, 0.4), (0.0, 0.2)])
def test_jitter_that_noise_hides_or_that_clocks_have_is_none(noise: float, jitter: float) -> None:
    clean, rng = record("planar", 52), np.random.default_rng(3)
    rough = {n: c + noise * rng.standard_normal(len(c)) for n, c in clean.columns.items()}
    late = rng.uniform(0.0, 0.01 * jitter, len(clean))
    assert not check(None, Recording(clean.t + late, rough)).findings
