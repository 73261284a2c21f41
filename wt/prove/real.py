"""Real machines as cases: their true effects are not known, so only held-out motions count.

The machines are in :mod:`wt.prove.machines`. Where the same commands were run again, the spread of
the runs is the floor: the error of a model that knew everything but chance. What a laboratory
fitted to its machine is replayed as ours is, with every motion at hand that it liked.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from wt.data import recording as recordings
from wt.errors import DataError
from wt.prove import replay
from wt.prove.answer import Answer
from wt.prove.machines.base import Machine, machines
from wt.worlds.rigs import write_mjcf

REAL = "real"


def present(home: Path) -> list[Machine]:
    """The machines whose recordings are in a folder.

    Raises:
        DataError: none is.
    """
    here = [machine for machine in machines().values() if (home / machine.folder).is_dir()]
    if not here:
        names = ", ".join(machine.folder for machine in machines().values())
        raise DataError(f"--machines: '{home}' holds recordings of none of {names}")
    return here


def write_case(machine: Machine, home: Path, case: Path) -> Answer:
    """Write a machine's model and recordings as a case; returns its answer, which is empty.

    Raises:
        DataError: a motion is missing or cannot be read.
    """
    shutil.rmtree(case, ignore_errors=True)
    for kind, motions in (("fit", machine.fit), ("holdout", machine.holdout)):
        for i, motion in enumerate(motions, 1):
            recordings.write(machine.read(home, motion), case / f"{kind}-{i}.parquet")
    write_mjcf(machine.given(), case / "robot.xml")
    return Answer(
        f"real-{machine.name}",
        REAL,
        (),
        (),
        rig=machine.name,
        noise_rms=_floor(machine, home),
        published_rmse=_published(machine, case),
        known=machine.known,
    )


def _published(machine: Machine, case: Path) -> float:
    """Error of what the laboratory fitted, on the held-out motions [rad or m]; NaN if nothing."""
    spec = machine.published()
    if spec is None:
        return np.nan
    held_out = replay.read(case / "robot.xml", sorted(case.glob("holdout-*.parquet")))
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "published.xml"
        write_mjcf(spec, model)
        return replay.rmse(model, held_out)


def _floor(machine: Machine, home: Path) -> dict[str, float]:
    """Joint → rms deviation of one run from the mean of two with the same commands."""
    squares: dict[str, list[float]] = {}
    for motion in machine.repeated:
        first, second = (machine.read(home, run) for run in (motion, f"repeats/{motion}"))
        n = min(len(first), len(second))
        for column in (c for c in first.columns if c.startswith("qpos/")):
            # two runs differ by √2 times what each is off by
            apart = (first.columns[column][:n] - second.columns[column][:n]) / np.sqrt(2.0)
            joint = column.removeprefix("qpos/")
            squares.setdefault(joint, []).append(float(np.nanmean(apart**2)))
    return {joint: float(np.sqrt(np.mean(means))) for joint, means in squares.items()}
