"""A table whose time is not in seconds is imported with a word about it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data.importers import base


@pytest.mark.parametrize(("unit", "per_second"), [("ms", 1e3), ("µs", 1e6), ("ns", 1e9)])
def test_time_in_another_unit_is_doubted(unit: str, per_second: float, tmp_path: Path) -> None:
    t = np.arange(0.0, 4.0, 0.01)
    rows = np.stack([t * per_second, np.sin(t), np.sin(t - 0.05)], axis=1)
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header="t,ctrl/a,qpos/a", comments="")
    columns = {"ctrl/a": "ctrl/a", "qpos/a": "qpos/a"}
    mapping: dict[str, object] = {"time": {"column": "t"}, "columns": columns}
    (doubt,) = (d for d in base.doubts(base.read(path, mapping), mapping) if "time" in d)
    assert f"looks like {unit}" in doubt
    assert f"scale: {1 / per_second:g}" in doubt
    seconds = {"time": {"column": "t", "scale": 1 / per_second}, "columns": columns}
    assert not [d for d in base.doubts(base.read(path, seconds), seconds) if "time" in d]
