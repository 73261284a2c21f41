"""Stepping replays side by side with ``mujoco.batch``, and what they report at the samples."""

from __future__ import annotations

import os
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from wt.batch import Batch
from wt.physics.acting import Acting, acting
from wt.physics.job import Job
from wt.physics.replay import Outputs, Stretch


def simulate(jobs: Sequence[Job], threads: int) -> list[Outputs]:
    """Run jobs of one layout side by side."""
    first = jobs[0]
    batch = _begun(jobs, threads)
    controls = _control_map(first)
    own = np.array([first.model.joint(name).dofadr[0] for name in first.scene.joints])
    steps, h = len(first.inputs.t), first.inputs.h
    acts = acting(first.scene, [job.hypothesis for job in jobs], h)
    nv = first.scene.model.nv
    results = [
        Outputs(j.stretch.recording, j.stretch.t, *np.full((2, len(j.stretch.t), nv), np.nan))
        for j in jobs
    ]
    same: dict[Stretch, list[int]] = {}
    for row, job in enumerate(jobs):
        same.setdefault(job.stretch, []).append(row)
    for start in range(0, steps, CHUNK):
        if _exploded(batch).all():
            break
        piece = slice(start, min(start + CHUNK, steps))
        if acts is None:
            path = _rolled(batch, jobs, own, controls, piece)
        else:
            path = _stepped(batch, jobs, own, controls, acts, piece)
        for stretch, rows in same.items():
            at = (stretch.t - stretch.t[0]) / h
            mine = [results[r] for r in rows]
            _record(mine, path[rows], at, start, np.inf if piece.stop == steps else piece.stop)
    exploded = _exploded(batch)
    for row, job in enumerate(jobs):
        if exploded[row]:  # there is nothing that a sensor could make of it
            results[row].q[:], results[row].v[:] = np.nan, np.nan
            continue
        for p in job.hypothesis:
            p.sense(results[row], job.scene)
    return results


def _begun(jobs: Sequence[Job], threads: int) -> Batch:
    """Simulations of jobs of one layout, in their initial states."""
    first = jobs[0]
    if first.live:
        threads = _awake(first.model.nv, len(jobs), threads)
    batch = Batch(first.model, nsim=len(jobs), nthread=threads)
    batch.set_models([job.model for job in jobs])
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    for row, job in enumerate(jobs):
        qpos[row], qvel[row] = job.initial()
    if first.model.na:
        act = batch.bind("act")
        for row, job in enumerate(jobs):
            act[row] = job.activations()
    return batch


def _awake(nv: int, replays: int, threads: int) -> int:
    """Threads that are worth waking at every step of replays that are stepped one at a time."""
    work = replays * (_STEP_US + nv * _DOF_US)
    cores = threads or os.cpu_count() or 1
    return min(cores, max(1, int(work / _WAKE_US)))


_STEP_US, _DOF_US = 1.5, 0.9
"""What a physics step takes [µs], and more for each degree of freedom: arms of one to six."""
_WAKE_US = 75.0
"""Work that a thread is woken for [µs]: several times what waking it takes on a busy machine."""
CHUNK = 2000
"""Physics steps per call: bounds memory, whatever the recording's length."""
_LOOKED_AFTER = 50
"""Steps after which replays that all have exploded are left."""


def _rolled(
    batch: Batch,
    jobs: Sequence[Job],
    own: Int[np.ndarray, " dof"],
    controls: Int[np.ndarray, " control"],
    piece: slice,
) -> Float[np.ndarray, "replay step state"]:
    """The machine's positions and velocities before and after some steps, (n, steps + 1, 2 nv)."""
    spec = mujoco.mjtState
    before = np.concatenate([batch.bind("qpos")[:, own], batch.bind("qvel")[:, own]], axis=1)
    u, flags = np.stack([job.inputs.u[piece] for job in jobs])[:, :, controls], spec.mjSTATE_CTRL
    if jobs[0].inputs.torque:
        flags |= spec.mjSTATE_QFRC_APPLIED
        u = np.concatenate([u, np.stack([_torques(job, piece) for job in jobs])], axis=2)
    if jobs[0].inputs.force:
        flags |= spec.mjSTATE_XFRC_APPLIED
        u = np.concatenate([u, np.stack([_wrenches(job, piece) for job in jobs])], axis=2)
    out = batch.rollout(u.shape[1], control=u, control_spec=int(flags), record=("qpos", "qvel"))
    after = np.concatenate([out["qpos"][..., own], out["qvel"][..., own]], axis=2)
    return np.concatenate([before[:, None], after], axis=1)


def _stepped(
    batch: Batch,
    jobs: Sequence[Job],
    own: Int[np.ndarray, " dof"],
    controls: Int[np.ndarray, " control"],
    acts: Acting,
    piece: slice,
) -> Float[np.ndarray, "replay step state"]:
    """The same where laws act at every step."""
    from wt.physics.compiled import turn  # takes a second to import

    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    applied, xfrc = batch.bind("qfrc_applied"), batch.bind("xfrc_applied")
    applied[:] = 0.0
    h = jobs[0].inputs.h
    # those of a step one after another in memory
    t = np.stack([job.inputs.t[piece] for job in jobs], axis=1)
    u = np.stack([job.inputs.u[piece] for job in jobs], axis=1)
    extra = np.stack([_torques(job, piece)[:, own] for job in jobs], axis=1)
    pushed = [(row, _wrenches(job, piece)) for row, job in enumerate(jobs) if job.inputs.force]
    path = np.empty((len(t) + 1, len(jobs), 2 * len(own)))
    given = (t, h, u, extra, own, controls, acts.laws, acts.places, acts.figures)
    for k in range(len(t)):
        turn(k, *given, qpos, qvel, path, ctrl, applied)
        for row, wrenches in pushed:
            xfrc[row] = wrenches[k].reshape(-1, 6)
        batch.step()
        if k % _LOOKED_AFTER == 0 and _exploded(batch).all():
            path[k + 1 :] = np.nan  # steps from nowhere take twenty times as long
            return path.swapaxes(0, 1)
    path[-1, :, : len(own)], path[-1, :, len(own) :] = qpos[:, own], qvel[:, own]
    return path.swapaxes(0, 1)


def _exploded(batch: Batch) -> Bool[np.ndarray, " replay"]:
    """Which simulations MuJoCo has warned of; it sets them back, and goes on."""
    return np.asarray(batch.warning[:, :, 1].any(axis=1))


def _wrenches(job: Job, piece: slice) -> Float[np.ndarray, "step wrench"]:
    """World-frame forces and torques on all bodies, (steps, 6 · nbody)."""
    wrenches = np.zeros((piece.stop - piece.start, job.model.nbody, 6))
    for body, force in job.inputs.force.items():
        wrenches[:, job.model.body(job.scene.model.body(body).name).id, :3] = force[piece]
    return wrenches.reshape(len(wrenches), -1)


def _torques(job: Job, piece: slice) -> Float[np.ndarray, "step dof"]:
    """Generalised forces on all degrees of freedom of the patched model, (steps, nv)."""
    torques = np.zeros((piece.stop - piece.start, job.model.nv))
    for dof, torque in job.inputs.torque.items():
        name = job.scene.model.joint(int(job.scene.model.dof_jntid[dof])).name
        torques[:, job.model.joint(name).dofadr[0]] = torque[piece]
    return torques


def _control_map(job: Job) -> Int[np.ndarray, " control"]:
    """For each control of the patched model the index of the user's actuator it belongs to."""
    return np.array(
        [job.scene.model.actuator(name).id for name in _controlled(job.model)], dtype=int
    )


def _controlled(model: mujoco.MjModel) -> list[str]:
    return [
        model.actuator(i).name
        for i in range(model.actuator_trnid.shape[0])
        for _ in range(model.actuator_ctrlnum[i])
    ]


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
