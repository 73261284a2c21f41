"""A learned law acts in ``physics.py`` as it does in the search's own replay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.mjcf.written import drive, error, load, planted, unhidden, write
from tests.physics.arm import ARM, Run, scene
from tests.physics.truths import TRUTHS
from wt.diagnose.unknown.force import UnknownForce, graphed
from wt.diagnose.unknown.law import Atom, Law
from wt.diagnose.unknown.memory import Memory
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.types import Location

WIDE = 1e3


def law(*columns: str, weight: float = 1.0) -> Law:
    """A force that is linear in the first column, and bends with the others."""
    terms = [(Atom(0, "linear"),), *((Atom(i, "square"),) for i in range(1, len(columns)))]
    ends = np.full(len(columns), WIDE)
    return Law(columns, -ends, ends, tuple(terms), np.full(len(terms), weight))


LAWS = {
    "state": law("qpos/j2", "qvel/j1", weight=-0.5),
    "creep": law(Memory("creep", "j1", 0.25).name, weight=-3.0),
    "swing": law(
        Memory("swing", "j1", 12.0, 0.1).name,
        Memory("swing_rate", "j1", 12.0, 0.1).name,
        weight=3.0,
    ),
    "overdamped": law(Memory("swing", "j1", 12.0, 2.0).name, weight=3.0),
    "drive": law("force/m1", "ctrl/m0", "t", weight=0.1),
}


def acting(found: Law, joint: str = "j1") -> Planted:
    effect = UnknownForce(found, f"Joint {joint} is pushed by something unknown.")
    return Planted(effect, Location("joint", joint), np.array([0.9]))


def replayed(folder: Path, hypothesis: tuple[Planted, ...], run: Run) -> np.ndarray:
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    return Replayer(scene(folder, ARM), [stretch]).run([hypothesis]).q[0]


def files(folder: Path, hypothesis: tuple[Planted, ...], run: Run) -> np.ndarray:
    named, graph = graphed(hypothesis)
    out = write(folder, named)
    assert graph is not None
    (out / "residual.onnx").write_bytes(graph)
    return drive(*load(out), run)


@pytest.mark.parametrize("name", LAWS)
def test_the_file_follows_the_replay(name: str, tmp_path: Path) -> None:
    run, hypothesis = unhidden(ARM), (acting(LAWS[name]),)
    own = replayed(tmp_path, hypothesis, run)
    moved = error(own, run)
    assert moved > 1e-3
    assert np.sqrt(np.mean((files(tmp_path, hypothesis, run) - own) ** 2)) < 1e-3 * moved


def test_two_laws_and_a_named_effect(tmp_path: Path) -> None:
    dead = next(t for t in TRUTHS if t.id == "actuator.deadband")
    both = (planted(dead), acting(LAWS["state"]), acting(LAWS["creep"], "j2"))
    run = unhidden(ARM)
    own = replayed(tmp_path, both, run)
    assert np.sqrt(np.mean((files(tmp_path, both, run) - own) ** 2)) < 1e-3 * error(own, run)
