"""Real machines as cases: their true effects are not known, so only held-out motions count.

Motions are fitted or held out, never both. Where the same commands were run again, the spread of
the runs is the floor: the error of a model that knew everything but chance.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wt.data import recording as recordings
from wt.data.importers import base
from wt.errors import DataError, suggest
from wt.prove.answer import Answer
from wt.types import Recording
from wt.worlds.rigs import spec_for, write_mjcf

REAL = "real"


@dataclass(frozen=True)
class RealMachine:
    """A machine and the split of its recordings.

    Attributes:
        name: of the case.
        folder: below the recordings.
        suffix: that the importer wants behind a motion's name.
        fit: motions to learn from.
        holdout: motions to score on.
        repeated: motions that were run again with the same commands, below ``repeats/``.
        seconds: of each recording that are used [s].
    """

    name: str
    folder: str
    suffix: str
    fit: tuple[str, ...]
    holdout: tuple[str, ...]
    repeated: tuple[str, ...] = ()
    seconds: float = np.inf


MACHINES = (
    RealMachine(
        "so101", "so101", "", ("multisine", "step_response"),
        ("fast_transitions", "single_joint_elbow"), ("fast_transitions",), 60.0,
    ),
    RealMachine(
        "double_pendulum", "dfki_double_pendulum", "", ("c1_143339", "c1_143524", "c1_143704"),
        ("c1_143601", "c1_144003"),
    ),
    RealMachine(
        "servo_bench", "bam_xl330", ".json", ("kp200_sin_sin", "kp200_sin_time_square"),
        ("kp200_up_and_down",),
    ),
)  # fmt: skip


def present(home: Path) -> list[RealMachine]:
    """The machines whose recordings are in a folder.

    Raises:
        DataError: none is.
    """
    machines = [machine for machine in MACHINES if (home / machine.folder).is_dir()]
    if not machines:
        names = ", ".join(machine.folder for machine in MACHINES)
        raise DataError(f"--machines: '{home}' holds recordings of none of {names}")
    return machines


def write_case(machine: RealMachine, home: Path, case: Path) -> Answer:
    """Write a machine's model and recordings as a case; returns its answer, which is empty.

    Raises:
        DataError: a motion is missing or cannot be read.
    """
    shutil.rmtree(case, ignore_errors=True)
    for kind, motions in (("fit", machine.fit), ("holdout", machine.holdout)):
        for i, motion in enumerate(motions, 1):
            recording = read(machine, home, motion, machine.seconds)
            recordings.write(recording, case / f"{kind}-{i}.parquet")
    write_mjcf(spec_for(recording.meta), case / "robot.xml")
    floor = _floor(machine, home)
    return Answer(f"real-{machine.name}", REAL, (), (), rig=machine.name, noise_rms=floor)


def _floor(machine: RealMachine, home: Path) -> dict[str, float]:
    """Joint → rms deviation of one run from the mean of two with the same commands."""
    squares: dict[str, list[float]] = {}
    for motion in machine.repeated:
        runs = (motion, f"repeats/{motion}")
        first, second = (read(machine, home, run, machine.seconds) for run in runs)
        n = min(len(first), len(second))
        for column in (c for c in first.columns if c.startswith("qpos/")):
            # two runs differ by √2 times what each is off by
            apart = (first.columns[column][:n] - second.columns[column][:n]) / np.sqrt(2.0)
            joint = column.removeprefix("qpos/")
            squares.setdefault(joint, []).append(float(np.nanmean(apart**2)))
    return {joint: float(np.sqrt(np.mean(means))) for joint, means in squares.items()}


def read(machine: RealMachine, home: Path, motion: str, seconds: float) -> Recording:
    """The first seconds of a machine's motion.

    Raises:
        DataError: there is no such motion.
    """
    folder = home / machine.folder
    path = folder / f"{motion}{machine.suffix}"
    if not path.exists():
        known = [p.name.removesuffix(machine.suffix) for p in folder.glob(f"*{machine.suffix}")]
        raise DataError(f"there is no motion '{path}'; {suggest(motion, known)}")
    recording = base.read(path)
    rows = recording.t <= recording.t[0] + seconds
    columns = {column: values[rows] for column, values in recording.columns.items()}
    return Recording(recording.t[rows], columns, recording.meta)
