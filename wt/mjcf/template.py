"""The class that :mod:`wt.mjcf.physics` fills in: copied as text, never imported for its own sake.

Remarks that begin with ``# <`` are where lines go in; helpers that no line calls are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

Array = np.ndarray


class Physics:
    """Adds to simulations of model.xml what MJCF has no element for.

    Hidden states have one entry a simulation and move on when the time does: forces that are asked
    for twice at the same time are the same, and a time that goes back begins anew.
    """

    # <joints>
    _scratch: mujoco.MjData
    _learned: Any

    def __init__(self, model: mujoco.MjModel, recording: int = 0) -> None:
        """Prepare for a model; events act at the times that they had in that recording."""
        self.model, self.recording = model, recording
        joints = map(model.joint, range(model.njnt))
        self._joints = {j.name: (int(j.qposadr[0]), int(j.dofadr[0])) for j in joints}
        self._actuators = {model.actuator(i).name: i for i in range(model.nactuator)}
        pid, late = model.actuator_dyntype == mujoco.mjtDyn.mjDYN_PID, model.actuator_delay > 0.0
        self._acting = np.where(pid, model.actuator_dynprm[:, 1] > 0.0, model.actuator_actnum == 1)
        self._late = np.flatnonzero((late | self._acting) & (model.actuator_ctrlnum == 1))
        self.begin: dict[str, Array] = {}  # hidden states to begin with, by name, where known
        self._t: Array | None = None
        self._now, self._next = dict[str, Array](), dict[str, Array]()
        self._before: Callable[..., None] | None = None
        self._attached = False
        # <init>
        self._gain, self._bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        # <given>

    def reset(self, data: mujoco.MjData) -> None:
        """Begin: hidden states at rest, commands as if data.ctrl had been there for long.

        Joints that the patch added are put in balance with data.qpos and data.qvel.
        """
        m, self._t, dyn = self.model, None, mujoco.mjtDyn
        slow = dyn.mjDYN_FILTER, dyn.mjDYN_FILTEREXACT, dyn.mjDYN_PID
        for i in np.flatnonzero(m.actuator_ctrlnum == 1):
            u, late = data.ctrl[m.actuator_ctrladr[i]], int(m.actuator_history[i, 0])
            if late:
                times = data.time - m.opt.timestep * np.arange(late, 0.0, -1.0)
                mujoco.mj_initCtrlHistory(m, data, i, times[:, None], np.full((late, 1), u))
            if int(m.actuator_dyntype[i]) in slow and self._acting[i]:
                data.act[m.actuator_actadr[i]] = u
        # <start>

    def step(self, data: mujoco.MjData) -> None:
        """In place of mujoco.mj_step(model, data)."""
        attached = self._attached
        self.attach()
        try:
            mujoco.mj_step(self.model, data)
        finally:
            if not attached:
                self.detach()

    def attach(self) -> None:
        """Act as MuJoCo's callback of passive forces from now on, whoever steps."""
        if not self._attached:
            self._before, self._attached = mujoco.get_mjcb_passive(), True
            mujoco.set_mjcb_passive(self._passive)

    def detach(self) -> None:
        """Give the callback back."""
        if self._attached:
            mujoco.set_mjcb_passive(self._before)
            self._attached = False

    def sense(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """What the real sensors report; t is (time,), q and v are (time, joint)."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        # <sense>
        return q, v

    def state(self, q: Array, v: Array) -> tuple[Array, Array]:
        """The motion behind what sensors report: sense undone, but for its rounding."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        # <undo>
        return q, v

    def forces(self, qpos: Array, qvel: Array, ctrl: Array, t: Array) -> Array:
        """Forces to add in n simulations, (n, nv) [N·m, N]; ask once every physics step.

        For parallel simulators: qpos is (n, nq), qvel (n, nv), t (n,) [s]; ctrl, (n, nu), are the
        commands as drives receive them, late or filtered if they are.
        """
        h, f = self.model.opt.timestep, np.zeros((len(t), self.model.nv))
        self._move(np.asarray(t, dtype=float), h)
        # <force>
        return f

    def _passive(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if self._before is not None:
            self._before(model, data)
        if model is self.model:  # callbacks are for all models of a process
            u, t = self._received(data)[None], np.array([data.time])
            data.qfrc_passive += self.forces(data.qpos[None], data.qvel[None], u, t)[0]

    def _received(self, data: mujoco.MjData) -> Array:
        """Commands as the drives receive them: late or filtered, where they are."""
        m, u = self.model, data.ctrl.copy()
        for i in self._late:
            k, got = m.actuator_ctrladr[i], np.zeros((1, 1))
            u[k] = data.act[m.actuator_actadr[i]] if self._acting[i] else u[k]
            if m.actuator_history[i, 0]:
                mujoco.mj_readCtrl(m, data, i, data.time, got, m.actuator_history[i, 1])
                u[k] = got[0, 0]
        return u

    def _move(self, t: Array, h: float) -> None:
        """Hidden states as they are at t."""
        if self._t is None or len(self._t) != len(t):
            self._t, self._now, self._next = t, dict(self.begin), {}
        moved = t > self._t + 0.75 * h  # not inside a step of Runge and Kutta's
        self._again = t < self._t
        for name, state in self._next.items():
            self._now[name] = np.where(moved, state, self._now[name])
        self._t = np.where(moved | self._again, t, self._t)

    def _state(self, name: str, begin: Array) -> Array:
        """A hidden state now; ``begin`` where a simulation begins, if nothing is known."""
        self._now[name] = np.where(self._again, begin, self._now.get(name, begin))
        return self._now[name]

    def _joint(self, name: str, qpos: Array, qvel: Array) -> tuple[Array, Array, int]:
        """Positions and velocities of a joint, and its degree of freedom."""
        # <base>
        q, dof = self._joints[name]
        return qpos[:, q], qvel[:, dof], dof

    def _base(self, name: str, qpos: Array, qvel: Array) -> tuple[Array, Array, int]:
        """The same of <free joint>/x, y, z, yaw, pitch or roll (Rz·Ry·Rx), and their rates."""
        joint, _, coordinate = name.rpartition("/")
        at, dof = self._joints[joint]
        w, x, y, z = qpos[:, at + 3 : at + 7].T
        a, b, c = qvel[:, dof + 3 : dof + 6].T
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        turn = (b * np.sin(roll) + c * np.cos(roll)) / np.cos(pitch)
        angles = {
            "yaw": (yaw, turn),
            "pitch": (pitch, b * np.cos(roll) - c * np.sin(roll)),
            "roll": (roll, a + turn * np.sin(pitch)),
        }
        if coordinate in angles:
            return *angles[coordinate], -1
        k = "xyz".index(coordinate)
        return qpos[:, at + k], qvel[:, dof + k], dof + k

    def _drive(self, name: str, qpos: Array, qvel: Array, ctrl: Array) -> tuple[Array, int]:
        """Force of a drive as the given model has it on its joint, and the degree of freedom."""
        m, i = self.model, self._actuators[name]
        joint = m.actuator_trnid[i, 0]
        dof = int(m.jnt_dofadr[joint])
        q, v = qpos[:, m.jnt_qposadr[joint]], qvel[:, dof]
        gear, u = m.actuator_gear[i, 0], ctrl[:, m.actuator_ctrladr[i]]
        if m.actuator_ctrllimited[i]:
            u = np.clip(u, *m.actuator_ctrlrange[i])
        force = self._gain[i, 0] * u
        if m.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_NONE:
            constant, stiffness, damping = self._bias[i, :3]
            force = force + constant + gear * (stiffness * q + damping * v)
        if m.actuator_forcelimited[i]:
            force = np.clip(force, *m.actuator_forcerange[i])
        return gear * force, dof

    def _bristle(self, name: str, v: Array, low: Array, high: Array, h: float) -> tuple[Array, int]:
        """Dry friction of a joint: a spring with a damper that slips at either of two forces."""
        dof = self._joints[name][1]
        inertia, v = 1.0 / self.model.dof_invweight0[dof], v[:, dof]
        stiffness, damping = inertia * (0.4 / h) ** 2, inertia * 0.4 / h
        bent = self._state(f"{name} bristle", 0.0 * v) + h * v
        bent = self._next[f"{name} bristle"] = np.clip(bent, low / stiffness, high / stiffness)
        return -np.clip(stiffness * bent + damping * v, low, high), dof

    def _push(self, body: str, force: Array, qpos: Array) -> Array:
        """Generalised forces of world-frame forces (n, 3) on a body's centre of mass."""
        torque, jacobian = np.zeros((len(qpos), self.model.nv)), np.zeros((3, self.model.nv))
        for i in np.flatnonzero(force.any(axis=1)):
            self._scratch.qpos[:] = qpos[i]
            mujoco.mj_kinematics(self.model, self._scratch)
            mujoco.mj_comPos(self.model, self._scratch)
            mujoco.mj_jacBodyCom(
                self.model, self._scratch, jacobian, None, self.model.body(body).id
            )
            torque[i] = force[i] @ jacobian
        return torque

    def _residual(self, output: str, columns: dict[str, Array]) -> Array:
        """A learned force (n,) of its columns, (n,) each."""
        given = {i.name: next(iter(columns.values())) for i in self._learned.get_inputs()}
        given = {k: x.astype(np.float32)[:, None] for k, x in (given | columns).items()}
        force: Array = self._learned.run([output], given)[0]
        return force[:, 0].astype(float)

    def _creep(self, name: str, v: Array, time_constant: float, h: float) -> Array:
        """Stretch of a spring that yields: its rate is v less itself over the time constant."""
        z, keep = self._state(name, 0.0 * v), np.exp(-h / time_constant)
        self._next[name] = keep * z + time_constant * (1.0 - keep) * v
        return z

    def _swing(
        self, name: str, q: Array, v: Array, rate: float, damping: float, h: float
    ) -> tuple[Array, Array]:
        """How far, and how fast, a mass on a spring and damper lags behind what drags it along."""
        lag = self._state(f"{name} p", q) - q
        speed = self._state(f"{name} w", v) - v
        # free and damped while v is held
        slow, root = damping * rate, rate * np.sqrt(complex(damping**2 - 1.0)) + 1e-12
        cosh, sinh = np.cosh(root * h).real, (np.sinh(root * h) / root).real
        fall = np.exp(-slow * h)
        ahead = fall * ((cosh + slow * sinh) * lag + sinh * speed)
        self._next[f"{name} p"] = q + h * v + ahead
        self._next[f"{name} w"] = v + fall * ((cosh - slow * sinh) * speed - rate**2 * sinh * lag)
        return lag, speed

    def _profile(
        self, name: str, ctrl: Array, speed: float, acceleration: float, h: float
    ) -> Array:
        """Goal of a servo, which moves to its command by a profile."""
        m, i = self.model, self._actuators[name]
        gear, u = m.actuator_gear[i, 0], ctrl[:, m.actuator_ctrladr[i]]
        u = np.clip(u, *m.actuator_ctrlrange[i]) if m.actuator_ctrllimited[i] else u
        at, rate = self._state(f"{name} profile", u), self._state(f"{name} profile's rate", 0.0 * u)
        speed, most = abs(gear) * speed, abs(gear) * acceleration * h
        # as fast as it can be stopped from in such steps
        fast = np.sqrt(0.25 * most**2 + 2.0 * most / h * np.abs(u - at)) - 0.5 * most
        fast = np.minimum(np.minimum(fast, speed), np.abs(u - at) / h)
        rate = rate + np.clip(np.sign(u - at) * fast - rate, -most, most)
        self._next[f"{name} profile"], self._next[f"{name} profile's rate"] = at + rate * h, rate
        return at + rate * h

    def _command(
        self, name: str, u: Array, qpos: Array, qvel: Array, ctrl: Array, f: Array
    ) -> Array:
        """Commands with another one (n,) for a drive, which adds to f what that makes of it."""
        m, i = self.model, self._actuators[name]
        joint, gear, k = m.actuator_trnid[i, 0], m.actuator_gear[i, 0], m.actuator_ctrladr[i]
        dof, pid = int(m.jnt_dofadr[joint]), m.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_PID
        commands = [u, ctrl[:, k]]
        if m.actuator_ctrllimited[i]:
            commands = [np.clip(x, *m.actuator_ctrlrange[i]) for x in commands]
        constant, stiffness, damping = m.actuator_biasprm[i, :3]
        rest = gear * (stiffness * qpos[:, m.jnt_qposadr[joint]] + damping * qvel[:, dof])
        gain = -stiffness if pid else m.actuator_gainprm[i, 0]
        forces = [gain * x + constant + rest for x in commands]
        if m.actuator_forcelimited[i]:
            forces = [np.clip(x, *m.actuator_forcerange[i]) for x in forces]
        f[:, dof] += gear * (forces[0] - forces[1])
        if pid:  # it has summed the error of the command as sent
            behind, h = self._state(f"{name} sum", 0.0 * u), m.opt.timestep
            self._next[f"{name} sum"] = behind + h * (commands[0] - commands[1])
            f[:, dof] += gear * m.actuator_gainprm[i, 0] * behind
        other = ctrl.copy()
        other[:, k] = commands[0]
        return other

    def _drives(self, joint: str, qpos: Array, qvel: Array, ctrl: Array) -> Array:
        """Force of all drives of a joint, or of its rotor if it has one of its own."""
        m, force = self.model, np.zeros(len(qpos))
        for name, i in self._actuators.items():
            on_joint = m.actuator_ctrlnum[i] == 1 and m.actuator_trntype[i] == 0
            if on_joint and m.joint(m.actuator_trnid[i, 0]).name in (joint, f"{joint}_rotor"):
                force = force + self._drive(name, qpos, qvel, ctrl)[0]
        return force

    def _gear(self, data: mujoco.MjData, joint: str) -> tuple[float, float]:
        """Force of a rotor's drives at its joint's angle, and by how much that falls per angle."""
        rotor, link = data.joint(f"{joint}_rotor"), data.joint(joint)
        u, forces = self._received(data)[None], []
        for turn in (0.0, 1e-6):
            rotor.qpos, rotor.qvel = link.qpos + turn, link.qvel
            forces.append(self._drives(joint, data.qpos[None], data.qvel[None], u)[0])
        return forces[0], max(0.0, (forces[0] - forces[1]) / 1e-6)
