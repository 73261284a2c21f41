"""Replays in which laws act at every step, from beginning to end in machine code."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.batch import time_steps
from wt.physics.acting import Acting
from wt.physics.caught import Landing, cannot_step, step_address
from wt.physics.job import Job

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


class Stepped:
    """Simulations of jobs of one layout in which laws act at every step."""

    def __init__(self, jobs: Sequence[Job], acts: Acting, threads: int) -> None:
        """In their initial states.

        Args:
            jobs: of one layout.
            acts: the laws that act in them.
            threads: how many to use; 0 for one a core.
        """
        self._jobs, self._acts = jobs, acts
        count = min(threads or os.cpu_count() or 1, len(jobs))
        edges = [len(jobs) * i // count for i in range(count + 1)]
        self._rows = [range(*pair) for pair in itertools.pairwise(edges)]
        time_steps(False)
        # what a thread steps in, one replay after another
        self._data = [mujoco.MjData(jobs[0].model) for _ in self._rows]
        self._warned = np.zeros(len(jobs), dtype=bool)
        self._states = np.empty((len(jobs), mujoco.mj_stateSize(jobs[0].model, _STATE)))
        d = self._data[0]
        for row, job in enumerate(jobs):
            mujoco.mj_resetData(job.model, d)
            d.qpos[:], d.qvel[:] = job.patched.initial(job.stretch)
            if job.model.na:
                d.act[:] = job.activations()
            if job.model.nplastic:
                job.bend(d.qpos, d.plastic)
            mujoco.mj_getState(job.model, d, self._states[row], _STATE)
        # those of a replay one after another, in the order in which their forces are summed
        self._order = np.argsort(acts.places[:, 0], kind="stable")
        replay = acts.places[self._order, 0]
        self._of_replay = np.searchsorted(replay, np.arange(len(jobs) + 1))

    def exploded(self) -> Bool[np.ndarray, " replay"]:
        """Which simulations MuJoCo has warned of."""
        return self._warned

    def path(self, piece: slice) -> Float[np.ndarray, "replay step state"]:
        """Positions and velocities before and after some steps, (n, steps + 1, 2 nv)."""
        steps = piece.stop - piece.start
        path = np.empty((len(self._jobs), steps + 1, 2 * len(self._jobs[0].own)))
        each = list(zip(self._rows, self._data, strict=True))
        if len(each) == 1:
            self._advance(each[0], piece, path)
        else:
            with ThreadPoolExecutor(len(each)) as pool:
                list(pool.map(lambda one: self._advance(one, piece, path), each))
        return path

    def _advance(
        self,
        one: tuple[range, mujoco.MjData],
        piece: slice,
        path: Float[np.ndarray, "replay step state"],
    ) -> None:
        """Step some replays in some data, one after another.

        Raises:
            WorkError: MuJoCo raised an error, and not a warning, in one of them.
        """
        from wt.physics.compiled import advance  # takes a second to import

        rows, d = one
        acts, step, landing = self._acts, step_address(), Landing()
        forces = d.qfrc_applied, d.xfrc_applied.reshape(-1)
        state = d.qpos, d.qvel, d.ctrl, *forces, d.warning.number
        for row in rows:
            if self._warned[row]:
                path[row] = np.nan
                continue
            job = self._jobs[row]
            mujoco.mj_resetData(job.model, d)
            mujoco.mj_setState(job.model, d, self._states[row], _STATE)
            given, here = job.inputs, self._order[slice(*self._of_replay[row : row + 2])]
            laws = acts.laws[here], acts.places[here, 1], acts.figures[here]
            extra = job.torques(piece)[:, job.own]
            wrenches = job.wrenches(piece) if given.force else np.zeros((len(extra), 0))
            inputs = given.t[piece], given.h, given.u[piece], extra, wrenches
            machine = step, job.model._address, d._address, landing.address
            if not advance(inputs, laws, job.sides, job.controls, machine, state, path[row]):
                raise cannot_step(landing.said())
            mujoco.mj_getState(job.model, d, self._states[row], _STATE)
            self._warned[row] = d.warning.number.any()
