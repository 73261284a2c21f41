"""A patched MJCF on held-out recordings, in plain MuJoCo: a measure for models of any origin.

No code of the diagnosis is used here. The file is compiled and stepped as it is, with its own
time step and integrator. A replay starts on the measured motion: for ``LEAD_S`` the machine's
joints are led along the recording, so that everything else that has a state (filters, delays, a
rotor behind a gear) finds it; then it runs open loop, commands held as recorded. A machine whose
joints are all held by position servos runs to the end of the recording, any other for ``WINDOW_S``
and then anew, since errors of a free joint grow without bound, whatever the model. A trunk that
floats is led like the joints; what is compared is the joints' positions.

Sensors that err have no element in MJCF; the findings of ``diagnosis.json`` that are about them
are applied to the replayed positions. A ``physics.py`` that was handed over with the file, for laws
that have no element either, steps the machine if it is asked for.
"""

from __future__ import annotations

import functools
import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from wt.data import recording as recordings
from wt.prove.replay_base import QUICK, Floating, fitted, floating, smooth
from wt.types import Recording

LEAD_S, WINDOW_S = 0.3, 0.5
_BAD = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
NO_RECORDING = -1
"""Recording of a ``Physics`` in which none of the events of any other happens."""
RAN_AWAY = 1.0
"""Error that a sample counts with after a replay exploded [rad or m]."""


@dataclass(frozen=True, eq=False)
class HeldOutRecording:
    """A held-out recording of a machine, prepared for replays.

    Attributes:
        joints: their names, as the given model has them.
        drives: names of the actuators whose commands were recorded.
        t: time since the start [s].
        q: measured positions [rad or m]; NaN where missing.
        smooth: position and velocity of a smoothing spline, for starts.
        u: commands in force from each sample.
        servoed: true if a position servo holds every joint, and none is free.
        base: the motion of the trunk, of a machine that floats.
    """

    joints: tuple[str, ...]
    drives: tuple[str, ...]
    t: Float[np.ndarray, " sample"]
    q: Float[np.ndarray, "sample joint"]
    smooth: Float[np.ndarray, "2 sample joint"]
    u: Float[np.ndarray, "sample drive"]
    servoed: bool
    base: Floating | None = None


def measure(recording: Recording, model: mujoco.MjModel) -> HeldOutRecording:
    """Prepare a recording.

    Args:
        recording: held out.
        model: the model as it was given, which names the joints.
    """
    single = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    joints = tuple(
        model.joint(i).name for i in range(model.njnt) if int(model.jnt_type[i]) in single
    )
    drives = tuple(
        model.actuator(i).name
        for i in range(model.nactuator)
        if f"ctrl/{model.actuator(i).name}" in recording.columns
    )
    servos = {
        int(model.actuator_trnid[i, 0])
        for i in range(model.nactuator)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator_biasprm[i, 1] < 0.0
    }
    servoed = servos >= set(range(model.njnt))
    t = recording.t - recording.t[0]
    missing = np.full(len(t), np.nan)
    q = np.stack([recording.columns.get(f"qpos/{joint}", missing) for joint in joints], axis=1)
    base = floating(recording, model, t)
    # where a machine is held, only the start needs a smooth motion
    rows = t <= (4.0 * LEAD_S if servoed else t[-1])
    curve = smooth if base is None else lambda t, x: fitted(t, x, QUICK)
    curves = np.zeros((2, *q.shape))
    curves[:, rows] = np.stack([curve(t[rows], column[rows]) for column in q.T], axis=2)
    sent = [_filled_forward(recording.columns[f"ctrl/{drive}"]) for drive in drives]
    u = np.stack(sent, axis=1) if sent else np.zeros((len(t), 0))
    return HeldOutRecording(joints, drives, t, q, curves, u, servoed, base)


def read(given: Path, held_out: Sequence[Path]) -> list[HeldOutRecording]:
    """Held-out recordings of a machine, prepared.

    Args:
        given: the MJCF as it was given, which names the joints.
        held_out: recordings that nothing was fitted to.
    """
    model = mujoco.MjModel.from_xml_path(str(given))
    return [measure(recordings.read(path), model) for path in held_out]


def rmse(
    model: Path,
    held_out: Sequence[HeldOutRecording],
    findings: Sequence[Mapping[str, Any]] = (),
    physics: Path | None = None,
) -> float:
    """Root mean square error of a model's replays [rad or m].

    MuJoCo warns of replays that explode; :func:`wt.physics.quiet.quiet` keeps that from view.

    Args:
        model: the MJCF to replay.
        held_out: recordings that nothing was fitted to.
        findings: of the diagnosis that the model belongs to, for sensors that err.
        physics: the ``physics.py`` that belongs to it. What happened at certain times of fitted
            recordings does not happen here.
    """
    compiled = mujoco.MjModel.from_xml_path(str(model))
    step = plain(compiled) if physics is None else by_file(physics, compiled)
    errors = [replay(compiled, recording, findings, step) - recording.q for recording in held_out]
    pooled = np.concatenate([error.ravel() for error in errors])
    known = pooled[~np.isnan(pooled)]
    return float(np.sqrt(np.mean(np.clip(known, -RAN_AWAY, RAN_AWAY) ** 2)))


class Stepping(NamedTuple):
    """How a machine is stepped.

    Attributes:
        reset: called with positions and commands set, before the first step.
        step: in place of ``mj_step``.
    """

    reset: Callable[[mujoco.MjData], None]
    step: Callable[[mujoco.MjData], None]


def plain(model: mujoco.MjModel) -> Stepping:
    """As MuJoCo does."""
    return Stepping(lambda data: None, functools.partial(mujoco.mj_step, model))


def by_file(physics: Path, model: mujoco.MjModel) -> Stepping:
    """As the class ``Physics`` of a file does."""
    made = runpy.run_path(str(physics))["Physics"](model, recording=NO_RECORDING)
    return Stepping(made.reset, made.step)


def replay(
    model: mujoco.MjModel,
    measured: HeldOutRecording,
    findings: Sequence[Mapping[str, Any]] = (),
    step: Stepping | None = None,
) -> Float[np.ndarray, "sample joint"]:
    """Positions that a model's sensors would report; NaN while it is led.

    Args:
        model: compiled, with the machine's joints and actuators among its own.
        measured: the recording to replay.
        findings: sensor effects among them are applied.
        step: how it is stepped; plainly if left out.
    """
    runner = _Runner(model, measured, findings, step or plain(model))
    positions = np.full_like(measured.q, np.nan)
    t = measured.t
    length = np.inf if measured.servoed else WINDOW_S
    start = t[0]
    while start + LEAD_S < t[-1]:
        end = min(start + LEAD_S + length, t[-1])
        rows = np.flatnonzero((t > start + LEAD_S) & (t <= end))
        runner.run(start, end)
        positions[rows] = runner.positions(t[rows])
        start = end - LEAD_S if end < t[-1] else t[-1]
    return positions


class _Runner:
    """Steps a model along a recording."""

    def __init__(
        self,
        model: mujoco.MjModel,
        measured: HeldOutRecording,
        findings: Sequence[Mapping[str, Any]],
        stepping: Stepping,
    ) -> None:
        self._model, self._measured, self._stepping = model, measured, stepping
        self._data = mujoco.MjData(model)
        self._sense = [f for f in findings if f["effect"].startswith("sensor.")]
        self._q = np.array([model.joint(name).qposadr[0] for name in measured.joints])
        self._v = np.array([model.joint(name).dofadr[0] for name in measured.joints])
        self._free = _slices(model, measured.base)
        self._ctrl = np.array([model.actuator(name).id for name in measured.drives], dtype=int)
        self._tied = _tied(model, measured.joints)
        self._t: Float[np.ndarray, " step"] = np.zeros(0)
        self._path: Float[np.ndarray, "step joint"] = np.zeros((0, len(measured.joints)))

    def run(self, start: float, end: float) -> None:
        """From ``start`` to ``end`` [s], led at first."""
        model, data, h = self._model, self._data, float(self._model.opt.timestep)
        mujoco.mj_resetData(model, data)
        steps = int(np.ceil((end - start) / h)) + 1
        self._t = start + h * np.arange(steps + 1)
        controls = self._controls(start, steps, h)
        q, v = (self._along(self._t, curve) for curve in self._measured.smooth)
        q, v = self._true(q, v)
        for i, (joint, ratio) in self._tied.items():
            data.qpos[i] = ratio * q[0, joint]
        lead = int(np.ceil(LEAD_S / h))
        base = self._measured.base
        pose, speed = base.at(self._t[: lead + 1]) if base else (None, None)
        self._path = np.empty_like(q)
        for k in range(steps):
            if k <= lead:
                data.qpos[self._q], data.qvel[self._v] = q[k], v[k]
                if pose is not None and speed is not None:
                    data.qpos[self._free[0]], data.qvel[self._free[1]] = pose[k], speed[k]
            self._path[k] = data.qpos[self._q]
            data.ctrl[self._ctrl] = controls[k]
            if k == 0:
                self._stepping.reset(data)
            self._stepping.step(data)
            # MuJoCo starts anew by itself when numbers are out of all bounds
            if any(data.warning[kind].number for kind in _BAD):
                self._path[k:] = np.inf
                return
        self._path[steps] = data.qpos[self._q]

    def positions(self, t: Float[np.ndarray, " sample"]) -> Float[np.ndarray, "sample joint"]:
        """Positions that the sensors report at given times [s]."""
        reported = np.empty((len(t), len(self._measured.joints)))
        for j in range(reported.shape[1]):
            late = sum(self._number(f, "delay") for f in self._of("sensor.delay", j))
            reported[:, j] = np.interp(t - late, self._t, self._path[:, j])
            for f in self._of("sensor.scale", j):
                reported[:, j] *= self._number(f, "factor")
            for f in self._of("sensor.offset", j):
                reported[:, j] += self._number(f, "offset")
            for f in self._of("sensor.quantization", j):
                step = self._number(f, "step")
                reported[:, j] = step * np.round(reported[:, j] / step)
        return reported

    def _true(
        self, q: Float[np.ndarray, "step joint"], v: Float[np.ndarray, "step joint"]
    ) -> tuple[Float[np.ndarray, "step joint"], Float[np.ndarray, "step joint"]]:
        """True positions and velocities for those that the sensors report.

        Delays are left to the lead.
        """
        q, v = q.copy(), v.copy()
        for j in range(q.shape[1]):
            for f in self._of("sensor.offset", j):
                q[:, j] -= self._number(f, "offset")
            for f in self._of("sensor.scale", j):
                q[:, j] /= self._number(f, "factor")
                v[:, j] /= self._number(f, "factor")
            for f in self._of("sensor.delay", j):
                q[:, j] += v[:, j] * self._number(f, "delay")
        return q, v

    def _of(self, effect: str, joint: int) -> list[Mapping[str, Any]]:
        names = ("all", self._measured.joints[joint])
        return [f for f in self._sense if f["effect"] == effect and f["at"]["name"] in names]

    @staticmethod
    def _number(finding: Mapping[str, Any], name: str) -> float:
        return float(finding["parameters"][name]["value"])

    def _controls(self, start: float, steps: int, h: float) -> Float[np.ndarray, "step drive"]:
        """Commands of every step: means of the recorded ones, held, around its start.

        MuJoCo's semi-implicit step stands for half a step before its time until half a step after.
        """
        t, u = self._measured.t, self._measured.u
        integral = np.zeros_like(u)
        integral[1:] = np.cumsum(u[:-1] * np.diff(t)[:, None], axis=0)
        knots = np.concatenate([[t[0] - 1.0], t, [t[-1] + 1.0]])
        integral = np.vstack([-u[0], integral, integral[-1] + u[-1]])
        edges = start + h * (np.arange(steps + 1) - 0.5)
        sums = np.empty((len(edges), integral.shape[1]))
        for i, column in enumerate(integral.T):
            sums[:, i] = np.interp(edges, knots, column)
        return np.asarray(np.diff(sums, axis=0) / h)

    def _along(
        self, t: Float[np.ndarray, " step"], curve: Float[np.ndarray, "sample joint"]
    ) -> Float[np.ndarray, "step joint"]:
        return np.stack([np.interp(t, self._measured.t, column) for column in curve.T], axis=1)


def _slices(model: mujoco.MjModel, base: Floating | None) -> tuple[slice, slice]:
    """Slices of a free joint's position and velocity."""
    if base is None:
        return slice(0), slice(0)
    joint = model.joint(base.joint)
    q, v = int(joint.qposadr[0]), int(joint.dofadr[0])
    return slice(q, q + 7), slice(v, v + 6)


def _tied(model: mujoco.MjModel, joints: Sequence[str]) -> dict[int, tuple[int, float]]:
    """Position address of each added joint that a fixed tendon ties to a joint of the machine.

    Where the tendon has no length, the added joint is ratio times the machine's.
    """
    ties: dict[int, tuple[int, float]] = {}
    own = {int(model.joint(name).id): i for i, name in enumerate(joints)}
    for tendon in range(model.ntendon):
        first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        wraps = range(first, first + count)
        if count != 2 or any(model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
            continue
        a, b = sorted(wraps, key=lambda w: int(model.wrap_objid[w]) in own)
        added, ours = int(model.wrap_objid[a]), int(model.wrap_objid[b])
        if added not in own and ours in own:
            ratio = -float(model.wrap_prm[b]) / float(model.wrap_prm[a])
            ties[int(model.jnt_qposadr[added])] = (own[ours], ratio)
    return ties


def _filled_forward(u: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    """Commands with the last known one where one is missing."""
    known = np.isfinite(u)
    last = np.maximum.accumulate(np.where(known, np.arange(len(u)), 0))
    return np.nan_to_num(u[last])
