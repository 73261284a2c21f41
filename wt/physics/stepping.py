"""Replays that run side by side, and what they report at the samples."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import SimulationError

from wt.batch import Batch
from wt.physics.acting import acting
from wt.physics.caught import cannot_step
from wt.physics.job import Job
from wt.physics.live_steps import Stepped
from wt.physics.replay import Outputs, Stretch


def simulate(jobs: Sequence[Job], threads: int) -> list[Outputs]:
    """Run jobs of one layout side by side."""
    first = jobs[0]
    steps, h = len(first.inputs.t), first.inputs.h
    acts = None
    if first.patched.live:
        acts = acting(first.scene, [job.patched.hypothesis for job in jobs], h)
    run = _Rolled(jobs, threads) if acts is None else Stepped(jobs, acts, threads)
    nv = first.scene.model.nv
    results = [
        Outputs(j.stretch.recording, j.stretch.t, *np.full((2, len(j.stretch.t), nv), np.nan))
        for j in jobs
    ]
    same: dict[Stretch, list[int]] = {}
    for row, job in enumerate(jobs):
        same.setdefault(job.stretch, []).append(row)
    for start in range(0, steps, CHUNK):
        if run.exploded().all():
            break
        piece = slice(start, min(start + CHUNK, steps))
        path = run.path(piece)
        for stretch, rows in same.items():
            at = (stretch.t - stretch.t[0]) / h
            mine = [results[r] for r in rows]
            _record(mine, path[rows], at, start, np.inf if piece.stop == steps else piece.stop)
    exploded = run.exploded()
    for row, job in enumerate(jobs):
        if exploded[row]:  # there is nothing that a sensor could make of it
            results[row].q[:], results[row].v[:] = np.nan, np.nan
            continue
        for p in job.patched.sensing:
            p.sense(results[row], job.scene)
    return results


CHUNK = 2000
"""Physics steps per call: bounds memory, whatever the recording's length."""


class _Rolled:
    """Simulations of jobs of one layout in which no law acts at every step."""

    def __init__(self, jobs: Sequence[Job], threads: int) -> None:
        """In their initial states."""
        self._jobs, first = jobs, jobs[0]
        self._batch = Batch(first.model, nsim=len(jobs), nthread=threads)
        self._batch.set_models([job.model for job in jobs])
        qpos, qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        for row, job in enumerate(jobs):
            qpos[row], qvel[row] = job.patched.initial(job.stretch)
        if first.model.na:
            act = self._batch.bind("act")
            for row, job in enumerate(jobs):
                act[row] = job.activations()
        if first.model.nplastic:
            plastic = self._batch.bind("plastic")
            for row, job in enumerate(jobs):
                job.bend(qpos[row], plastic[row])

    def exploded(self) -> Bool[np.ndarray, " replay"]:
        """Which simulations MuJoCo has warned of; it sets them back, and goes on."""
        return np.asarray(self._batch.warning[:, :, 1].any(axis=1))

    def path(self, piece: slice) -> Float[np.ndarray, "replay step state"]:
        """Positions and velocities before and after some steps, (n, steps + 1, 2 nv).

        Raises:
            WorkError: MuJoCo raised an error, and not a warning, in one of them.
        """
        jobs, batch, own = self._jobs, self._batch, self._jobs[0].own
        spec = mujoco.mjtState
        before = np.concatenate([batch.bind("qpos")[:, own], batch.bind("qvel")[:, own]], axis=1)
        u = np.stack([job.inputs.u[piece] for job in jobs])[:, :, jobs[0].controls]
        flags = spec.mjSTATE_CTRL
        if jobs[0].inputs.torque:
            flags |= spec.mjSTATE_QFRC_APPLIED
            u = np.concatenate([u, np.stack([job.torques(piece) for job in jobs])], axis=2)
        if jobs[0].inputs.force:
            flags |= spec.mjSTATE_XFRC_APPLIED
            u = np.concatenate([u, np.stack([job.wrenches(piece) for job in jobs])], axis=2)
        try:
            out = batch.rollout(
                u.shape[1], control=u, control_spec=int(flags), record=("qpos", "qvel")
            )
        except SimulationError as error:
            raise cannot_step(batch.error(int(error.ids[0]))) from error
        after = np.concatenate([out["qpos"][..., own], out["qvel"][..., own]], axis=2)
        return np.concatenate([before[:, None], after], axis=1)


def _record(
    results: Sequence[Outputs],
    path: Float[np.ndarray, "replay step state"],
    at: Float[np.ndarray, " sample"],
    start: int,
    stop: int | float,
) -> None:
    """Read the samples inside steps start…stop off paths, (n, steps + 1, 2 nv), of one stretch.

    Args:
        results: of each replay, filled in place.
        path: positions and velocities after each step.
        at: samples [steps].
        start: first step.
        stop: last one; infinite for the last piece, whose last sample may lie a rounding error past
            the last step.
    """
    mine = np.flatnonzero((at >= start - 1e-9) & (at <= stop + 1e-9))
    where = at[mine] - start
    low = np.clip(np.floor(where + 1e-9).astype(int), 0, path.shape[1] - 2)
    part = np.clip(where - low, 0.0, 1.0)[:, None]
    values = path[:, low] * (1.0 - part) + path[:, low + 1] * part
    nv = values.shape[2] // 2
    for result, value in zip(results, values, strict=True):
        result.q[mine], result.v[mine] = value[:, :nv], value[:, nv:]
