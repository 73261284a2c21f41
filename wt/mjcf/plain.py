"""Replays what ``wt diagnose`` wrote, in plain MuJoCo: a program that needs nothing of ours.

    python plain.py DIAGNOSIS OUT.npz [MODEL.xml]

DIAGNOSIS holds ``model.xml``, ``holdout.npz`` and, for what MJCF cannot say, ``physics.py``. OUT
gets the positions (N, joint) that sensors would report at the N held-out samples, NaN in a window
whose replay exploded: ``model`` of model.xml alone, ``physics`` with physics.py, if it is there,
and ``before`` of the MODEL that was given.

Each window starts on the smoothed measurements of its first sample, with joints that the patch
added where the search had them, with commands that were sent before on their way through drives
that are late or slow, and with the model's own filters and integrators where they had got to; then
it runs open loop at the model's own time step. A command comes half a step after its time, to make
up for MuJoCo's semi-implicit step, in which a force acts half a step early.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

Array = np.ndarray

_BAD = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
_DYNAMICS = (
    int(mujoco.mjtDyn.mjDYN_FILTER),
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT),
    int(mujoco.mjtDyn.mjDYN_INTEGRATOR),
)


def main(arguments: Sequence[str]) -> None:
    """Run as the module says."""
    folder, out, *given = map(Path, arguments)
    with np.load(folder / "holdout.npz", allow_pickle=False) as stored:
        stored_windows = dict(stored)
    replays = {"model": replay(_compiled(folder / "model.xml"), None, stored_windows)}
    if (folder / "physics.py").exists():
        model = _compiled(folder / "model.xml")
        replays["physics"] = replay(model, _physics(folder / "physics.py", model), stored_windows)
    for path in given:
        replays["before"] = replay(_compiled(path), None, stored_windows)
    np.savez(out, **replays)  # type: ignore[arg-type]  # numpy's stub takes no names


def replay(model: mujoco.MjModel, physics: Any, stored: Mapping[str, Array]) -> Array:  # noqa: ANN401
    """Positions at all samples of all windows, (N, joint)."""
    ends = [*stored["first"][1:], len(stored["t"])]
    windows = zip(stored["first"], ends, strict=True)
    return np.concatenate(
        [_window(model, physics, stored, w, slice(*rows)) for w, rows in enumerate(windows)]
    )


def _window(
    model: mujoco.MjModel,
    physics: Any,  # noqa: ANN401
    stored: Mapping[str, Array],
    window: int,
    rows: slice,
) -> Array:
    """Positions at the samples of one window, (K, joint)."""
    t, h, joints = stored["t"][rows], float(model.opt.timestep), _Joints(model, stored["joints"])
    steps = max(1, int(np.ceil((t[-1] - t[0]) / h - 1e-6)))
    ctrl = [model.actuator_ctrladr[model.actuator(str(name)).id] for name in stored["actuators"]]
    before, u = _commands(*_sent(stored, window, rows), t[0], h, steps)
    data = mujoco.MjData(model)
    data.time, data.ctrl[ctrl] = t[0], stored["command"][rows][0]
    begun = stored["q0"][window], stored["v0"][window]
    if physics is not None:
        begun = physics.state(*begun)
        physics.recording = int(stored["recording"][window])
    joints.put(data, *begun)
    if physics is not None:
        physics.reset(data)
    _fill(model, data, stored["actuators"], stored["activation"][window], u[: before + 1])
    _remind(model, data, physics, stored, window)
    u = u[before:]
    known = [model.joint(j).name for j in range(model.njnt)]
    for k, name in enumerate(map(str, stored["added"])):
        if name in known:
            data.joint(name).qpos = stored["added_q"][window, k]
            data.joint(name).qvel = stored["added_v"][window, k]
    path = np.empty((2, steps + 1, len(stored["joints"])))
    path[:, 0] = joints.read(data)
    for k in range(steps):
        data.ctrl[ctrl] = u[k]
        mujoco.mj_step(model, data) if physics is None else physics.step(data)
        path[:, k + 1] = joints.read(data)
    if any(data.warning[kind].number for kind in _BAD):
        return np.full((len(t), path.shape[2]), np.nan)
    path[0] = joints.unwrapped(path[0], begun[0])
    times = t[0] + h * np.arange(steps + 1)
    q = path[0] if physics is None else physics.sense(times, *path)[0]
    return np.stack([np.interp(t, times, column) for column in q.T], axis=1)


def _sent(stored: Mapping[str, Array], window: int, rows: slice) -> tuple[Array, Array]:
    """Times and commands of a window, and those sent before it."""
    ends = [*stored["lead_first"][1:], len(stored["lead_t"])]
    lead = slice(stored["lead_first"][window], ends[window])
    times = np.append(stored["lead_t"][lead], stored["t"][rows])
    return times, np.vstack([stored["lead"][lead], stored["command"][rows]])


def _commands(t: Array, command: Array, begin: float, h: float, steps: int) -> tuple[int, Array]:
    """Commands of every step, (before + steps, actuator), of which the first lead to the window.

    Each is the mean over a step's length around its start.
    """
    before = int(np.ceil((begin - t[0]) / h))
    integral = np.zeros_like(command)
    integral[1:] = np.cumsum(command[:-1] * np.diff(t)[:, None], axis=0)
    # a command is held until the next; the first was held before, and the last goes on
    knots = np.concatenate([[t[0] - 1.0], t, [t[-1] + 1.0]])
    integral = np.vstack([-command[0], integral, integral[-1] + command[-1]])
    edges = begin + h * (np.arange(-before, steps + 1) - 0.5)
    means = [np.diff(np.interp(edges, knots, column)) / h for column in integral.T]
    sent = np.stack(means, axis=1) if means else np.zeros((before + steps, 0))
    # what came before the first has had its effect on the state there
    sent[before] = command[np.searchsorted(t, begin)]
    return before, sent


def _fill(
    model: mujoco.MjModel, data: mujoco.MjData, names: Array, acts: Array, sent: Array
) -> None:
    """What was sent before is on its way through drives that are late or slow.

    Args:
        model: the machine.
        data: at the begin of a window.
        names: actuators.
        acts: of those that the user's own model gives dynamics, what they act on; else NaN.
        sent: commands of the steps before, and of the first in the window, (before + 1, actuator).
    """
    h = model.opt.timestep
    for name, act, u in zip(map(str, names), acts, sent.T, strict=True):
        i = model.actuator(name).id
        late, delay = int(model.actuator_history[i, 0]), float(model.actuator_delay[i])
        if late:
            times = h * np.arange(-late, 0.0)
            known = np.interp(times, h * np.arange(1 - len(u), 1), u)
            mujoco.mj_initCtrlHistory(model, data, i, (data.time + times)[:, None], known[:, None])
        if int(model.actuator_dyntype[i]) not in _DYNAMICS:
            continue
        if np.isnan(act):
            steps = np.arange(len(u))
            arrived = np.interp(steps - delay / h, steps, u)
            keep, act = np.exp(-h / max(float(model.actuator_dynprm[i, 0]), 1e-9)), arrived[0]
            for value in arrived[:-1]:
                act = value + (act - value) * keep
        data.act[model.actuator_actadr[i]] = act


def _remind(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    physics: Any,  # noqa: ANN401
    stored: Mapping[str, Array],
    window: int,
) -> None:
    """States that come of all that was before a window: goals and integrals of servos, bends."""
    known = {} if physics is None else physics.begin
    known.clear()
    for k, name in enumerate(map(str, stored.get("remembered", ()))):
        x, (actuator, _, what) = float(stored["remembered_x"][window, k]), name.rpartition(" ")
        known[name] = np.array(x)
        if what == "bend":
            _bend(model, data, actuator, x)
        if what not in ("goal", "integral"):
            continue
        i = model.actuator(actuator).id
        if int(model.actuator_dyntype[i]) == mujoco.mjtDyn.mjDYN_PID:  # not so as it was given
            last = int(model.actuator_actnum[i]) - 1 if what == "integral" else 0
            data.act[model.actuator_actadr[i] + last] = x


def _bend(model: mujoco.MjModel, data: mujoco.MjData, tendon: str, x: float) -> None:
    """The spring of a tendon that yields is bent by so much."""
    known = [model.tendon(i).name for i in range(model.ntendon)]
    i = known.index(tendon) if tendon in known else -1
    if i >= 0 and model.tendon_plasticadr[i] >= 0:  # not so as it was given
        along = slice(model.tendon_adr[i], model.tendon_adr[i] + model.tendon_num[i])
        length = model.wrap_prm[along] @ data.qpos[model.jnt_qposadr[model.wrap_objid[along]]]
        data.plastic[model.tendon_plasticadr[i] :][:2] = length - x


class _Joints:
    """The recorded joints of a model; a floating base is <free joint>/x, y, z, yaw, pitch, roll."""

    def __init__(self, model: mujoco.MjModel, names: Array) -> None:
        known = {model.joint(j).name: j for j in range(model.njnt)}
        single = [k for k, name in enumerate(names) if str(name) in known]
        joints = [known[str(names[k])] for k in single]
        self.single = np.array(single, dtype=int)
        self.q, self.v = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        free = [k for k, name in enumerate(names) if k not in single and name.endswith("/x")]
        bases = [known[str(names[k]).removesuffix("/x")] for k in free]
        self.bases = [
            (k, model.jnt_qposadr[j], model.jnt_dofadr[j]) for k, j in zip(free, bases, strict=True)
        ]

    def put(self, data: mujoco.MjData, q: Array, v: Array) -> None:
        """Set positions and velocities, (joint,)."""
        data.qpos[self.q], data.qvel[self.v] = q[self.single], v[self.single]
        for k, at, dof in self.bases:
            _, pitch, roll = angles = q[k + 3 : k + 6]
            turned = np.zeros(4)
            mujoco.mju_euler2Quat(turned, angles, "zyx")
            data.qpos[at : at + 7] = *q[k : k + 3], *turned
            turn, nod, lean = v[k + 3 : k + 6]
            side = turn * np.cos(pitch)
            data.qvel[dof : dof + 6] = (
                *v[k : k + 3],
                lean - turn * np.sin(pitch),
                side * np.sin(roll) + nod * np.cos(roll),
                side * np.cos(roll) - nod * np.sin(roll),
            )

    def read(self, data: mujoco.MjData) -> Array:
        """Positions and velocities, (2, joint)."""
        coordinates = np.empty((2, len(self.single) + 6 * len(self.bases)))
        coordinates[:, self.single] = data.qpos[self.q], data.qvel[self.v]
        for k, at, dof in self.bases:
            coordinates[:, k : k + 6] = _coordinates(
                data.qpos[at : at + 7], data.qvel[dof : dof + 6]
            )
        return coordinates

    def unwrapped(self, path: Array, begun: Array) -> Array:
        """A path (steps, joint) whose angles of bases go on from where they began."""
        for k, *_ in self.bases:
            angles = np.unwrap(path[:, k + 3 : k + 6], axis=0)
            turns = np.round((begun[k + 3 : k + 6] - angles[0]) / (2.0 * np.pi))
            path[:, k + 3 : k + 6] = angles + 2.0 * np.pi * turns
        return path


def _coordinates(pose: Array, rates: Array) -> tuple[Array, Array]:
    """x, y, z, yaw, pitch, roll (Rz·Ry·Rx) of a free joint and their rates, (6,) each."""
    w, x, y, z = pose[3:]
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    a, b, c = rates[3:]
    turn = (b * np.sin(roll) + c * np.cos(roll)) / np.cos(pitch)
    angles = [turn, b * np.cos(roll) - c * np.sin(roll), a + turn * np.sin(pitch)]
    return np.array([*pose[:3], yaw, pitch, roll]), np.array([*rates[:3], *angles])


def _compiled(path: Path) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(path))


def _physics(path: Path, model: mujoco.MjModel) -> Any:  # noqa: ANN401
    spec = importlib.util.spec_from_file_location("physics", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Physics(model)


if __name__ == "__main__":
    main(sys.argv[1:])
