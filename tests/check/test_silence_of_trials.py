"""Recordings of the concealed trials give no line: clean ones, and some whose springs once did."""

from __future__ import annotations

from pathlib import Path

import pytest

from wt.check.run import check
from wt.data import recording as recordings
from wt.physics.scene import Scene
from wt.prove.bench import write_files
from wt.prove.case import Case
from wt.prove.cases import cases

CLEAN = [c for c in cases("nulls", 1) if "pendulum" in c.name][:1]
SPRINGS = [
    pytest.param(c, id=c.name, marks=pytest.mark.long)
    for c in cases("full", 412)
    if c.name.endswith(("pendulum-joint.stiffness-clear", "pendulum-outsider.rubber-clear"))
]
"""The command that holds against a spring looked early; one that hardens, like a tilted base."""


@pytest.mark.parametrize("case", [*CLEAN, *SPRINGS], ids=lambda c: c.name)
def test_no_line(case: Case, tmp_path: Path) -> None:
    write_files(case, tmp_path)
    scene = Scene(tmp_path / "robot.xml")
    for path in sorted(tmp_path.glob("*.parquet")):
        found = check(scene, recordings.read(path)).findings
        assert not [f.kind for f in found if f.sure], path.name
