"""Missing samples: what was commanded meanwhile still counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.physics.arm import scene
from wt.diagnose.samples import LONG_GAP, Part, samples_of
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
    assert np.isnan(found.q[200:203]).all() and np.isfinite(found.held).all()
    assert found.held[201, 0] == np.sin(3.0 * found.t[201])


def test_a_long_gap_ends_a_segment(tmp_path: Path) -> None:
    gap = int(LONG_GAP / 0.01) + 3
    first, second = samples_of(scene(tmp_path), [recording(tmp_path, slice(200, 200 + gap))])
    assert len(first.t) == 200
    assert second.t[0] == first.t[-1] + 0.01 * (gap + 1)
