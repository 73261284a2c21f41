"""Replays of recordings on patched models, many at once with ``mujoco.batch``."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.batch import Batch
from wt.physics.acting import Acting, acting, is_live, neighbours
from wt.physics.activation import activated, dynamic, late
from wt.physics.lean import rest_idle
from wt.physics.limbs import Limb, Limbs, limbs
from wt.physics.live import StepState
from wt.physics.planted import Planted
from wt.physics.quiet import quiet
from wt.physics.replay import Inputs, Outputs, Stretch
from wt.physics.runner import chosen
from wt.physics.scene import Scene
from wt.types import Location


@dataclass(frozen=True, eq=False)
class Replays:
    """Reports of replays of hypotheses at the samples of all stretches, one after another.

    Attributes:
        q: joint positions, (H, N, nv); NaN where a replay exploded.
        v: joint velocities, (H, N, nv).
    """

    q: Float[np.ndarray, "hypothesis sample dof"]
    v: Float[np.ndarray, "hypothesis sample dof"]


class Replayer:
    """Replays stretches of recordings on models patched by hypotheses.

    The simulations of a call run side by side; each has its own compiled model. Where they run is
    for :func:`wt.physics.spread.over` to say.
    """

    def __init__(self, scene: Scene, stretches: Sequence[Stretch], step: float = 5e-4) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            step: physics step [s]. It need not divide the sampling interval: commands are averaged
                over steps, and what sensors report is interpolated between them.
        """
        self.scene = scene
        self.stretches = tuple(stretches)
        self.step = step
        lengths = [(s.t[-1] - s.t[0]) / self.step for s in self.stretches]
        self.shortest = max(1, int(np.ceil(min(lengths) - 1e-6)))
        self._inputs: dict[Stretch, Inputs] = {}

    def run(self, hypotheses: Sequence[Sequence[Planted]]) -> Replays:
        """Replay every stretch on every hypothesis."""
        return Replays(*chosen().replay(self, hypotheses))

    @quiet()  # replays of bad hypotheses explode, and NaN says it
    def part(
        self, hypotheses: Sequence[Sequence[Planted]], stretches: Sequence[int], threads: int
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """Replay some stretches on some hypotheses in this process.

        What one replay says does not depend, to the bit, on which others run beside it. Limbs that
        are independent are replayed apart, each as often as hypotheses differ in it.

        Args:
            hypotheses: H of them.
            stretches: indices of the stretches.
            threads: how many to use; 0 for one a core.

        Returns:
            Positions and velocities at the N samples of these stretches, one after another,
            (2, H, N, nv); NaN where a replay exploded.
        """
        parts = [None if self._limbs is None else self._limbs.on(h) for h in hypotheses]
        apart = [(h, part) for h, part in enumerate(parts) if part is not None]
        whole = [h for h, part in enumerate(parts) if part is None]
        samples = sum(len(self.stretches[s].t) for s in stretches)
        path = np.empty((2, len(hypotheses), samples, self.scene.model.nv))
        if whole:
            path[:, whole] = self._whole([hypotheses[h] for h in whole], stretches, threads)
        for k, (limb, own) in enumerate(self._own if apart else ()):
            contents = [_contents(part[k]) for _, part in apart]
            different = dict(zip(contents, (part[k] for _, part in apart), strict=True))
            said = own.part(list(different.values()), stretches, threads)
            of = dict(zip(different, said.swapaxes(0, 1), strict=True))
            for (h, _), content in zip(apart, contents, strict=True):
                path[:, h][..., limb.dofs] = of[content]
        return path

    @functools.cached_property
    def _limbs(self) -> Limbs | None:
        motion = self.stretches[0].motion
        return None if motion is None else limbs(self.scene, motion)

    @functools.cached_property
    def _own(self) -> tuple[tuple[Limb, Replayer], ...]:
        """Each limb, with the replays of it alone."""
        each = self._limbs.each if self._limbs else ()
        return tuple(
            (limb, Replayer(limb.scene, [limb.stretch(s) for s in self.stretches], self.step))
            for limb in each
        )

    def _whole(
        self, hypotheses: Sequence[Sequence[Planted]], stretches: Sequence[int], threads: int
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """See :meth:`part`: all of the machine at once."""
        samples = [len(self.stretches[s].t) for s in stretches]
        ends = np.cumsum(samples)
        path = np.full((2, len(hypotheses), int(ends[-1]), self.scene.model.nv), np.nan)
        groups: dict[tuple[object, ...], list[tuple[int, int, _Job]]] = {}
        for h, hypothesis in enumerate(hypotheses):
            try:
                model = self.compile(hypothesis)
            except (ValueError, mujoco.FatalError):
                # MuJoCo refuses such parameters: as bad as a replay that explodes
                continue
            for k, s in enumerate(stretches):
                job = _Job(self, hypothesis, self.stretches[s], model)
                groups.setdefault(job.layout, []).append((h, k, job))
        for members in groups.values():
            for outputs, (h, k, _) in zip(
                _simulate([job for *_, job in members], threads), members, strict=True
            ):
                rows = slice(ends[k] - samples[k], ends[k])
                path[0, h, rows], path[1, h, rows] = outputs.q, outputs.v
        return path

    def inputs(self, stretch: Stretch) -> Inputs:
        """Inputs of a stretch before any effect changes them."""
        if stretch not in self._inputs:
            h = self.step
            # whole chunks, so that recordings of nearly the same length run side by side
            chunk = min(CHUNK, self.shortest)
            steps = chunk * int(np.ceil((stretch.t[-1] - stretch.t[0]) / (h * chunk) - 1e-6))
            before = stretch.steps_before(h)
            t = stretch.t[0] + h * np.arange(-before, steps)
            u = stretch.commands(h, steps, before)
            given = Inputs(stretch.recording, t, h, u, before=before)
            for i in late(self.scene.model):
                own = float(self.scene.model.actuator_delay[i])
                given.u[:, i] = given.delayed(given.u[:, i], own)
            self._inputs[stretch] = given
        return self._inputs[stretch]

    def compile(self, hypothesis: Sequence[Planted]) -> mujoco.MjModel:
        """The model of a hypothesis, with the replays' time step."""
        spec = self.scene.slim.copy()
        spec.option.timestep = self.step
        for planted in hypothesis:
            planted.model(spec)
        model = spec.compile()
        rest_idle(model)
        return model


def _contents(hypothesis: Sequence[Planted]) -> tuple[tuple[int, Location, bytes], ...]:
    """What two hypotheses have in common that say the same."""
    return tuple((id(p.effect), p.at, p.theta.tobytes()) for p in hypothesis)


def initial_states(
    scene: Scene, hypothesis: Sequence[Planted], stretch: Stretch
) -> dict[str, tuple[float, float]]:
    """Positions and velocities that a replay starts from, by joint, those that are added last."""
    start = Outputs(stretch.recording, stretch.t[:1], stretch.q0[None], stretch.v0[None])
    sensed = Outputs(start.recording, start.t, start.q.copy(), start.v.copy())
    for p in hypothesis:
        p.sense(sensed, scene)
    # what was measured is what the sensors made of it: undo an offset or a scale
    q, v = 2.0 * start.q[0] - sensed.q[0], 2.0 * start.v[0] - sensed.v[0]
    dofs = [(name, scene.dof(name)) for name in scene.joints]
    known = {name: (float(q[dof]), float(v[dof])) for name, dof in dofs}
    begun = replace(stretch, q0=q, v0=v)
    for p in hypothesis:
        known |= {name: known[leader] for name, leader in p.followers().items()}
        for name, hidden in p.started(begun).items():
            dq, dv = stretch.shifts.get(name, (0.0, 0.0))
            known[name] = (hidden.position + dq, hidden.velocity + dv)
    return known


def begun(model: mujoco.MjModel, stretch: Stretch) -> Float[np.ndarray, " actuator"]:
    """What each drive of a model acts on where a stretch begins."""
    if stretch.activation is not None:
        return stretch.activation
    return activated(model, stretch.t[:1], stretch.command[:1])[0]


class _Job:
    """One stretch on one hypothesis."""

    def __init__(
        self,
        owner: Replayer,
        hypothesis: Sequence[Planted],
        stretch: Stretch,
        model: mujoco.MjModel,
    ) -> None:
        self.scene = owner.scene
        self.hypothesis = tuple(hypothesis)
        self.stretch = stretch
        self.model = model
        given = owner.inputs(stretch)
        self.inputs = replace(given, u=given.u.copy(), force={}, torque={})
        for p in hypothesis:
            p.drive(self.inputs, self.scene)
        self.inputs = self.inputs.of_replay()
        self.live, steps = any(is_live(p.effect) for p in hypothesis), len(self.inputs.t)
        pushed = bool(self.inputs.force), bool(self.inputs.torque)
        self.layout = (*_sizes(self.model), steps, *pushed, self.live)

    def initial(self) -> tuple[Float[np.ndarray, " joint"], Float[np.ndarray, " joint"]]:
        """Positions and velocities to start from, in the order of the patched model's joints."""
        known = initial_states(self.scene, self.hypothesis, self.stretch)
        states = np.array([known[self.model.joint(i).name] for i in range(self.model.njnt)])
        return states[:, 0], states[:, 1]

    def activations(self) -> Float[np.ndarray, " activation"]:
        """Activations to start from, in the order of the patched model's."""
        given, start = self.scene.model, begun(self.scene.model, self.stretch)
        act = np.zeros(self.model.na)
        for i in np.flatnonzero(dynamic(given)):
            act[self.model.actuator(given.actuator(i).name).actadr[0]] = start[i]
        return act


@functools.cache
def _size_names() -> tuple[str, ...]:
    """MjModel's integer sizes, apart from those of texts and names."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    names = [name for name in dir(model) if name.startswith("n") and "name" not in name]
    skip = {"nbuffer", "npaths", "ntextdata", "narena", "nconmax", "njmax"}
    return tuple(n for n in names if n not in skip and isinstance(getattr(model, n), int))


def _sizes(model: mujoco.MjModel) -> tuple[int, ...]:
    """Sizes that two models must share to be simulated in one batch."""
    return tuple(getattr(model, name) for name in _size_names())


def _simulate(jobs: Sequence[_Job], threads: int) -> list[Outputs]:
    """Run jobs of one layout side by side."""
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
    controls = _control_map(first)
    acts = acting(first.scene, [job.hypothesis for job in jobs])
    steps, h = len(first.inputs.t), first.inputs.h
    nv = first.scene.model.nv
    results = [
        Outputs(j.stretch.recording, j.stretch.t, *np.full((2, len(j.stretch.t), nv), np.nan))
        for j in jobs
    ]
    own = np.array([first.model.joint(name).dofadr[0] for name in first.scene.joints])
    for start in range(0, steps, CHUNK):
        stop = min(start + CHUNK, steps)
        before = np.concatenate([qpos[:, own], qvel[:, own]], axis=1)[:, None]
        states = _advance(batch, jobs, own, controls, acts, start, stop)
        path = np.concatenate([before, states[..., np.concatenate([own, first.model.nq + own])]], 1)
        for row, job in enumerate(jobs):
            at = (job.stretch.t - job.stretch.t[0]) / h
            _record(results[row], path[row], at, start, np.inf if stop == steps else stop)
    exploded = batch.warning[:, :, 1].any(axis=1)
    for row, job in enumerate(jobs):
        if exploded[row]:  # there is nothing that a sensor could make of it
            results[row].q[:], results[row].v[:] = np.nan, np.nan
            continue
        for p in job.hypothesis:
            p.sense(results[row], job.scene)
    return results


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
    jobs: Sequence[_Job],
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
    extra = np.stack([_torques(job, start, stop)[:, own] for job in jobs], axis=1)
    pushed = [
        (row, _wrenches(job, start, stop)) for row, job in enumerate(jobs) if job.inputs.force
    ]
    for k in range(stop - start):
        q, v, command, force = qpos[:, mine].copy(), qvel[:, mine].copy(), u[k], extra[k]
        for act in acts:
            rows = act.rows
            now = StepState(t[k, rows], h, q[rows], v[rows], command[rows], force[rows])
            act.live.act(now)
            if not isinstance(rows, slice):  # picked out of the batch: put back
                command[rows], force[rows] = now.u, now.applied
        ctrl[:], applied[:, mine] = command[:, sent], force
        for row, wrenches in pushed:
            xfrc[row] = wrenches[k].reshape(-1, 6)
        batch.step()
        states[k, :, : qpos.shape[1]], states[k, :, qpos.shape[1] :] = qpos, qvel
    return states.swapaxes(0, 1)


def _wrenches(job: _Job, start: int, stop: int) -> Float[np.ndarray, "step wrench"]:
    """World-frame forces and torques on all bodies, (steps, 6 · nbody)."""
    wrenches = np.zeros((stop - start, job.model.nbody, 6))
    for body, force in job.inputs.force.items():
        wrenches[:, job.model.body(job.scene.model.body(body).name).id, :3] = force[start:stop]
    return wrenches.reshape(stop - start, -1)


def _torques(job: _Job, start: int, stop: int) -> Float[np.ndarray, "step dof"]:
    """Generalised forces on all degrees of freedom of the patched model, (steps, nv)."""
    torques = np.zeros((stop - start, job.model.nv))
    for dof, torque in job.inputs.torque.items():
        name = job.scene.model.joint(int(job.scene.model.dof_jntid[dof])).name
        torques[:, job.model.joint(name).dofadr[0]] = torque[start:stop]
    return torques


def _control_map(job: _Job) -> Int[np.ndarray, " control"]:
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
    results: Outputs,
    path: Float[np.ndarray, "step state"],
    at: Float[np.ndarray, " sample"],
    start: int,
    stop: int | float,
) -> None:
    """Read the samples inside steps start…stop off a path, (steps + 1, 2 nv).

    ``stop`` is infinite for the last piece: a sample may lie a rounding error past the last step.
    """
    mine = np.flatnonzero((at >= start - 1e-9) & (at <= stop + 1e-9))
    where = at[mine] - start
    low = np.clip(np.floor(where + 1e-9).astype(int), 0, len(path) - 2)
    part = np.clip(where - low, 0.0, 1.0)[:, None]
    values = path[low] * (1.0 - part) + path[low + 1] * part
    nv = values.shape[1] // 2
    results.q[mine], results.v[mine] = values[:, :nv], values[:, nv:]
