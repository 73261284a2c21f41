"""Logs that are slower than their controller: the commands between the samples are filled in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import RATE, STEP, chain, record
from wt.diagnose.recordings.commands import commands_each
from wt.diagnose.recordings.samples import Part, Samples, finer
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.physics.scene import Scene
from wt.types import Recording

# another machine than the model, whose replays lag for reasons of its own
RUBS = chain(2).replace('damping=".3"', 'damping=".8"')
LIGHT = chain(2).replace('damping=".3"', 'damping=".05"', 1)


def thinned(recording: Recording, every: int) -> Recording:
    columns = {name: column[::every] for name, column in recording.columns.items()}
    return Recording(recording.t[::every], columns)


def counted(folder: Path, made_by: str, every: int) -> tuple[int, Smoothed]:
    path = folder / "robot.xml"
    path.write_text(chain(2))
    parts = (Part(thinned(record(made_by, None, 6.0, 0), every), 0),)
    smoothed = smooth(Scene(path), parts)
    return commands_each(smoothed, parts, True, 2.0 * STEP), smoothed


def test_commands_between_the_samples_of_a_slow_log_are_counted(tmp_path: Path) -> None:
    count, _ = counted(tmp_path, chain(2), 6)  # a controller of 200 Hz, logged at 33
    assert count in (5, 6, 8)  # a command more or less hardly matters


@pytest.mark.parametrize("made_by", [chain(2), RUBS, LIGHT], ids=["as is", "rubs", "light"])
def test_a_log_of_every_command_is_left_as_it_is(tmp_path: Path, made_by: str) -> None:
    count, smoothed = counted(tmp_path, made_by, 1)
    assert count == 1
    assert smoothed.commands == 1
    assert smoothed.samples[0].dt == pytest.approx(1.0 / RATE)


def test_what_is_filled_in_lies_between_and_was_not_measured() -> None:
    t = np.array([0.0, 0.03, 0.06, 0.1, 0.13, 0.16])
    steps = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])[:, None]
    fine = finer(Samples(0, t, t[:, None], t[:, None], steps, steps), 3)
    np.testing.assert_allclose(fine.t[::3], t)
    np.testing.assert_array_equal(fine.q[::3, 0], t)
    assert np.isnan(np.delete(fine.q[:, 0], np.arange(0, 16, 3))).all()
    assert (fine.command >= -1e-9).all()
    assert (fine.command <= 1.0 + 1e-9).all()


def test_knots_follow_the_samples_and_not_the_clock(tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(chain(1))
    even = record(chain(1), None, 4.0, 0)
    kept = np.sort(np.random.default_rng(0).choice(len(even.t), len(even.t) // 2, replace=False))
    kept[0], kept[-1] = 0, len(even.t) - 1
    columns = {n: c[kept] for n, c in even.columns.items() if not n.startswith("qvel")}
    whole, uneven = (
        smooth(Scene(path), [Part(r, 0)]) for r in (even, Recording(even.t[kept], columns))
    )
    usual = np.abs(whole.motion.a).max()
    assert np.abs(uneven.motion.a).max() < 1.5 * usual
