"""The hidden machine of a case, for a contender that may ask it.

Between the two are files, as between ``wt ask --robot file`` and a person: commands are found as
``experiment_N.parquet`` in the contender's folder, and what was measured is put beside them as
``recorded_N.parquet``. So the machine stays on this side of the walls.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np

from wt.data import recording as recordings
from wt.prove.case import Case
from wt.prove.controllers import positions
from wt.prove.rigs import RIGS
from wt.prove.world import LEAD_S, hidden_plant, measured

MOTIONS = ("creep", "multisine", "multisine", "multisine", "mixture")
"""Of a case that can be asked: what there is at first, as many multisines as may be asked for, for
a control, and the motion that is held out."""


class AskedMachine:
    """Carries out what a contender asks for, in processes of its own.

    Attributes:
        reach: of each experiment that was carried out, the furthest that a joint went from the
            middle of its range, over half of that range [-]; above 1 it left it.
    """

    def __init__(self, case: Case, processes: Executor) -> None:
        """Nothing was asked yet.

        Args:
            case: what is hidden where, on a rig of position servos.
            processes: where its worlds are simulated.
        """
        self._case, self._processes = case, processes
        self._begun: list[Future[float]] = []
        self.reach: list[float] = []

    def attend(self, folder: Path) -> None:
        """Begin what is newly asked for in a folder, and see what has ended; never waits."""
        number = len(self._begun) + 1
        commands = folder / f"experiment_{number}.parquet"
        if commands.is_file():
            recorded = folder / f"recorded_{number}.parquet"
            begun = self._processes.submit(perform, self._case, number, commands, recorded)
            self._begun.append(begun)
        self.reach = [future.result() for future in self._begun if future.done()]

    def said(self) -> Mapping[str, object]:
        """For ``ran.json``."""
        return {"experiments": len(self.reach), "reach": max(self.reach, default=0.0)}


def perform(case: Case, number: int, commands: Path, recorded: Path) -> float:
    """Have the hidden machine follow commands, and write what it measures, whole.

    Args:
        case: the machine.
        number: of the experiment, which decides the noise.
        commands: recording with ``ctrl/<actuator>``, and the first pose as ``qpos/<joint>``.
        recorded: file that is written.

    Returns:
        As in :attr:`AskedMachine.reach`.
    """
    sent, rig = recordings.read(commands), RIGS[case.rig]
    rng = np.random.default_rng([case.seed, 9, number])
    plant = hidden_plant(case)
    steps = np.rint(sent.t / plant.h).astype(int)
    path = np.zeros((len(steps), len(rig.links)))
    for i, (joint, link) in enumerate(zip(rig.joints, rig.links, strict=True)):
        name = f"ctrl/{joint}_drive"
        path[:, i] = sent.columns[name] if link.driven else sent.columns[f"qpos/{joint}"][0]
    begin = np.array([sent.columns[f"qpos/{joint}"][0] for joint in rig.joints])
    trace = plant.run(begin, steps, positions(path), round(LEAD_S / plant.h))
    recordings.write(measured(case, plant, trace, steps, rng)[0], recorded)
    spans = np.array([link.span for link in rig.links])
    middle, half = spans.mean(axis=1), np.ptp(spans, axis=1) / 2.0
    return float((np.abs(trace.fine_q - middle) / half).max())
