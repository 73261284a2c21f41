"""A slice of the concealed trials' clean recordings gives no line."""

from __future__ import annotations

from pathlib import Path

import pytest

from wt.check.run import check
from wt.data import recording as recordings
from wt.physics.scene import Scene
from wt.prove.bench import write_files
from wt.prove.cases import cases

CASES = {c.name: c for c in cases("nulls", 1) if "pendulum" in c.name}


@pytest.mark.parametrize("name", sorted(CASES)[:1])
def test_a_clean_trial(name: str, tmp_path: Path) -> None:
    write_files(CASES[name], tmp_path)
    scene = Scene(tmp_path / "robot.xml")
    for path in sorted(tmp_path.glob("*.parquet")):
        found = check(scene, recordings.read(path)).findings
        assert not [f.kind for f in found if f.sure], path.name
