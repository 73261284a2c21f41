"""Stepping replays side by side with ``mujoco.batch``, and what they report at the samples."""

from __future__ import annotations

import os
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.batch import Batch
from wt.physics.acting import Acting, acting, neighbours
from wt.physics.job import Job
from wt.physics.live import StepState
from wt.physics.replay import Outputs, Stretch


def simulate(jobs: Sequence[Job], threads: int) -> list[Outputs]:
    """Run jobs of one layout side by side."""
    first = jobs[0]
    batch = _begun(jobs, threads)
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    controls = _control_map(first)
    own = np.array([first.model.joint(name).dofadr[0] for name in first.scene.joints])
    acts = acting(first.scene, [job.hypothesis for job in jobs])
    steps, h = len(first.inputs.t), first.inputs.h
    nv = first.scene.model.nv
    results = [
        Outputs(j.stretch.recording, j.stretch.t, *np.full((2, len(j.stretch.t), nv), np.nan))
        for j in jobs
    ]
    same: dict[Stretch, list[int]] = {}
    for row, job in enumerate(jobs):
        same.setdefault(job.stretch, []).append(row)
    for start in range(0, steps, CHUNK):
        stop = min(start + CHUNK, steps)
        before = np.concatenate([qpos[:, own], qvel[:, own]], axis=1)[:, None]
        states = _advance(batch, jobs, own, controls, acts, start, stop)
        path = np.concatenate([before, states[..., np.concatenate([own, first.model.nq + own])]], 1)
        for stretch, rows in same.items():
            at = (stretch.t - stretch.t[0]) / h
            mine = [results[r] for r in rows]
            _record(mine, path[rows], at, start, np.inf if stop == steps else stop)
    exploded = batch.warning[:, :, 1].any(axis=1)
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


def _advance(
    batch: Batch,
    jobs: Sequence[Job],
    own: Int[np.ndarray, " dof"],
    controls: Int[np.ndarray, " control"],
    acts: Sequence[Acting],
    start: int,
    stop: int,
) -> Float[np.ndarray, "replay step state"]:
    """Positions and velocities after each of some steps, (n, steps, nq + nv)."""
    spec = mujoco.mjtState
    u = np.stack([job.inputs.u[start:stop] for job in jobs])
    if not acts:
        u = u[:, :, controls]
        flags = int(spec.mjSTATE_CTRL)
        if jobs[0].inputs.torque:
            flags |= int(spec.mjSTATE_QFRC_APPLIED)
            u = np.concatenate([u, np.stack([_torques(job, start, stop) for job in jobs])], axis=2)
        if jobs[0].inputs.force:
            flags |= int(spec.mjSTATE_XFRC_APPLIED)
            u = np.concatenate([u, np.stack([_wrenches(job, start, stop) for job in jobs])], axis=2)
        out = batch.rollout(stop - start, control=u, control_spec=flags, record=("qpos", "qvel"))
        return np.concatenate([out["qpos"], out["qvel"]], axis=2)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    applied, xfrc = batch.bind("qfrc_applied"), batch.bind("xfrc_applied")
    applied[:] = 0.0
    states = np.empty((stop - start, len(jobs), qpos.shape[1] + qvel.shape[1]))
    h = jobs[0].inputs.h
    # step by step, and slices where they do: what is copied here is copied at every step
    mine, sent = neighbours(own), neighbours(controls)
    t = np.stack([job.inputs.t[start:stop] for job in jobs], axis=1)
    u = np.ascontiguousarray(u.swapaxes(0, 1))
    # those of a step one after another in memory, for laws to be added to
    extra = np.ascontiguousarray(
        np.stack([_torques(job, start, stop)[:, own] for job in jobs], axis=1)
    )
    pushed = [
        (row, _wrenches(job, start, stop)) for row, job in enumerate(jobs) if job.inputs.force
    ]
    for k in range(stop - start):
        q, v, command, force = qpos[:, mine].copy(), qvel[:, mine].copy(), u[k], extra[k]
        for act in acts:
            rows = act.rows
            now = StepState(t[k, rows], h, q[rows], v[rows], command[rows])
            act.add(act.live.force(now), force.reshape(-1))
        ctrl[:], applied[:, mine] = command[:, sent], force
        for row, wrenches in pushed:
            xfrc[row] = wrenches[k].reshape(-1, 6)
        batch.step()
        states[k, :, : qpos.shape[1]], states[k, :, qpos.shape[1] :] = qpos, qvel
    return states.swapaxes(0, 1)


def _wrenches(job: Job, start: int, stop: int) -> Float[np.ndarray, "step wrench"]:
    """World-frame forces and torques on all bodies, (steps, 6 · nbody)."""
    wrenches = np.zeros((stop - start, job.model.nbody, 6))
    for body, force in job.inputs.force.items():
        wrenches[:, job.model.body(job.scene.model.body(body).name).id, :3] = force[start:stop]
    return wrenches.reshape(stop - start, -1)


def _torques(job: Job, start: int, stop: int) -> Float[np.ndarray, "step dof"]:
    """Generalised forces on all degrees of freedom of the patched model, (steps, nv)."""
    torques = np.zeros((stop - start, job.model.nv))
    for dof, torque in job.inputs.torque.items():
        name = job.scene.model.joint(int(job.scene.model.dof_jntid[dof])).name
        torques[:, job.model.joint(name).dofadr[0]] = torque[start:stop]
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
