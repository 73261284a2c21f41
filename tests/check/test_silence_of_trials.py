"""Recordings of the concealed trials give no line: clean ones, and some whose springs once did."""

from __future__ import annotations

from pathlib import Path

import pytest

from wt.check.run import check
from wt.data import recording as recordings
from wt.physics.scene import Scene
from wt.prove.bench import write_files
from wt.prove.cases import cases

CLEAN = ("nulls", 1, "002-pendulum-coloured_noise")
SPRINGS = [
    pytest.param("full", 412, name, id=name, marks=pytest.mark.long)
    for name in ("022-pendulum-joint.stiffness-clear", "193-pendulum-outsider.rubber-clear")
]
"""The command that holds against a spring looked early; one that hardens, like a tilted base."""


@pytest.mark.parametrize(("of", "seed", "name"), [pytest.param(*CLEAN, id=CLEAN[-1]), *SPRINGS])
def test_no_line(of: str, seed: int, name: str, tmp_path: Path) -> None:
    (case,) = (c for c in cases(of, seed) if c.name == name)
    write_files(case, tmp_path)
    scene = Scene(tmp_path / "robot.xml")
    for path in sorted(tmp_path.glob("*.parquet")):
        found = check(scene, recordings.read(path)).findings
        assert not [f.kind for f in found if f.sure], path.name
