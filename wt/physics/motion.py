"""The motion of a recording at every sample, and the forces that a model makes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import uniform_filter1d

from wt.physics.activation import dynamic
from wt.physics.contact import Touching, touching
from wt.physics.ground import Floor, floors
from wt.physics.scene import Drive, Scene

_BLOW_S, _BLOW = 0.05, 8.0
"""A blow shows so long [s], and makes the residual's change so many times what it usually is."""


_OFF = mujoco.mjtDisableBit
NOT_DEMANDED = int(
    _OFF.mjDSBL_CONTACT | _OFF.mjDSBL_LIMIT | _OFF.mjDSBL_ACTUATION | _OFF.mjDSBL_EQUALITY
)
"""What inverse dynamics leave out, so that they say what a motion demands of all of it together."""


@dataclass(frozen=True)
class Segment:
    """A stretch without gaps of one recording, evenly sampled.

    Attributes:
        rows: its rows in a :class:`Motion`.
        recording: which recording it belongs to.
        dt: sampling interval [s].
    """

    rows: slice
    recording: int
    dt: float


@dataclass(frozen=True, eq=False)
class Motion:
    """Smoothed recordings of one machine on even grids, T samples in all, segment after segment.

    Attributes:
        scene: the machine.
        segments: the stretches without gaps; stateful laws start anew in each.
        t: time since the start of the sample's recording, (T,) [s].
        q: joint positions, (T, nv) [rad or m].
        v: joint velocities, (T, nv).
        a: joint accelerations, (T, nv).
        command: the command sent at each sample and held until the next, (T, nu).
    """

    scene: Scene
    segments: tuple[Segment, ...]
    t: Float[np.ndarray, " sample"]
    q: Float[np.ndarray, "sample dof"]
    v: Float[np.ndarray, "sample dof"]
    a: Float[np.ndarray, "sample dof"]
    command: Float[np.ndarray, "sample actuator"]

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median([s.dt for s in self.segments]))

    @cached_property
    def u(self) -> Float[np.ndarray, "sample actuator"]:
        """Mean command over the interval centred on each sample, (T, nu).

        A command that is held from sample to sample changes *at* the sample, so the force that
        belongs to the acceleration there is that of ½(u[k−1] + u[k]).
        """
        mean = np.empty_like(self.command)
        for i in range(self.command.shape[1]):
            mean[:, i] = self.delayed(i, 0.0)
        return mean

    def delayed(self, actuator: int, delay: float) -> Float[np.ndarray, " sample"]:
        """Command of one actuator that arrives late, (T,), averaged as :attr:`u`.

        Args:
            actuator: its index.
            delay: how late [s]; before a segment the first command is held.
        """
        late = np.empty(len(self))
        for s in self.segments:
            u = self.command[s.rows, actuator]
            edges = np.arange(len(u) + 1) * s.dt
            integral = np.concatenate([[0.0], np.cumsum(u)]) * s.dt
            end = edges[:-1] + 0.5 * s.dt - delay
            start = end - s.dt
            # ∫u over [start, end] / dt; np.interp clamps, so what came before is added by hand
            before = np.minimum(end, 0.0) - np.minimum(start, 0.0)
            impulse = np.interp(end, edges, integral) - np.interp(start, edges, integral)
            late[s.rows] = (impulse + before * u[0]) / s.dt
        return late

    def force(
        self, drive: Drive, u: Float[np.ndarray, " sample"] | None = None
    ) -> Float[np.ndarray, " sample"]:
        """Force of a drive on its joint, (T,) [N·m].

        Args:
            drive: the actuator.
            u: other commands than the recorded, (T,).
        """
        command = self.u[:, drive.index] if u is None else u
        return drive.force(command, self.q[:, drive.dof], self.v[:, drive.dof])

    def shifted(
        self,
        dq: Float[np.ndarray, "sample dof"],
        dv: Float[np.ndarray, "sample dof"] | None = None,
        da: Float[np.ndarray, "sample dof"] | None = None,
    ) -> Motion:
        """The same recording with other positions, velocities and accelerations, (T, nv) each."""
        zero = np.zeros_like(self.q)
        v, a = self.v + (zero if dv is None else dv), self.a + (zero if da is None else da)
        return Motion(self.scene, self.segments, self.t, self.q + dq, v, a, self.command)

    def later(
        self, signal: Float[np.ndarray, "sample dof"], lead: Float[np.ndarray, "sample dof"]
    ) -> Float[np.ndarray, "sample dof"]:
        """Change of a signal within ``lead`` [s]."""
        change = np.zeros_like(signal)
        for s in self.segments:
            t = self.t[s.rows]
            for dof in range(signal.shape[1]):
                x = signal[s.rows, dof]
                change[s.rows, dof] = np.interp(t + lead[s.rows, dof], t, x) - x
        return change

    def on(
        self, dof: int, *forces: Float[np.ndarray, " sample"]
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Forces (T,) each on one degree of freedom as columns, (T, nv, k)."""
        columns = np.zeros((*self.q.shape, len(forces)))
        columns[:, dof] = np.stack(forces, axis=1)
        return columns

    @cached_property
    def drive_forces(self) -> Float[np.ndarray, "sample dof"]:
        """Force of all actuators on each degree of freedom, (T, nv) [N·m]."""
        total = self._beside_drives()
        for drive in self.scene.drives:
            total[:, drive.dof] += self.force(drive)
        return total

    def _beside_drives(self) -> Float[np.ndarray, "sample dof"]:
        total, m = np.zeros_like(self.q), self.scene.beside_drives
        if m is None:
            return total
        data, acting = mujoco.MjData(m), np.flatnonzero(dynamic(m))
        for k, (q, v, u) in enumerate(zip(self.q, self.v, self.u, strict=True)):
            data.qpos[:], data.qvel[:] = q, v
            data.ctrl[m.actuator_ctrladr], data.act[m.actuator_actadr[acting]] = u, u[acting]
            mujoco.mj_fwdPosition(m, data)
            mujoco.mj_fwdVelocity(m, data)
            mujoco.mj_fwdActuation(m, data)
            total[k] = data.qfrc_actuator
        return total

    @cached_property
    def demand(self) -> Float[np.ndarray, "sample dof"]:
        """Force that the model's bodies and passive elements demand for this motion, (T, nv)."""
        return self.inverse(self.scene.model)

    @cached_property
    def residual(self) -> Float[np.ndarray, "sample dof"]:
        """Generalised force that acted on the machine and that the model lacks, (T, nv) [N·m].

        Inverse dynamics minus the force of the drives; forces of contacts are in it.
        """
        return self.demand - self.drive_forces

    @cached_property
    def touching(self) -> Touching:
        """Contact that may have acted: of a force residual, only the free part is evidence."""
        return touching(self.scene, self.q, self.floors)

    @cached_property
    def floors(self) -> tuple[Floor, ...]:
        """Planes of the model on which the machine stands, where they are not as the model says."""
        return floors(self.scene, self.q, self.v)

    @cached_property
    def unexplained(self) -> Float[np.ndarray, "sample dof"]:
        """The free part of the residual, (T, nv) [N·m]: what no contact may have supplied."""
        return self.touching.free(self.residual)

    @cached_property
    def calm(self) -> Bool[np.ndarray, " sample"]:
        """Moments in which no foot lands, (T,) bool: the residual changes no faster than usual.

        A blow lasts a sample or two and is many times as large as what else is missing.
        """
        if not self.scene.free:
            return np.ones(len(self), dtype=bool)
        scaled = self.unexplained / (np.std(self.unexplained, axis=0) + 1e-12)
        change = np.zeros(len(self))
        for s in self.segments:
            fast = np.sum(np.gradient(scaled[s.rows], axis=0) ** 2, axis=1)
            change[s.rows] = uniform_filter1d(fast, max(1, round(_BLOW_S / s.dt)))
        return np.asarray(change <= _BLOW * np.median(change))

    @cached_property
    def recorded(self) -> Motion:
        """The motion before any force was taken out: what moves is the same."""
        return self

    def without(self, force: Float[np.ndarray, "sample dof"]) -> Motion:
        """The same recording with a known force, (T, nv) [N·m], taken out of the residual."""
        rest = replace(self)
        known = {
            name: getattr(self, name) for name in ("demand", "drive_forces", "touching", "floors")
        }
        rest.__dict__.update(known, residual=self.residual - force, recorded=self.recorded)
        return rest

    def inverse(self, model: mujoco.MjModel) -> Float[np.ndarray, "sample dof"]:
        """Inverse dynamics of this motion on a model with the same joints, (T, nv) [N·m].

        Actuators, contacts, limits and what couples joints are left out; passive forces count.
        """
        if model is self.scene.model:
            model = mujoco.MjModel.__copy__(model)
        flags = model.opt.disableflags
        model.opt.disableflags |= NOT_DEMANDED
        data = mujoco.MjData(model)
        # to ask the data for its arrays takes as long as what is asked of them
        q, v, a, force = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
        result = np.empty_like(self.q)
        for k in range(len(self.t)):
            q[:], v[:], a[:] = self.q[k], self.v[k], self.a[k]
            mujoco.mj_inverse(model, data)
            result[k] = force
        model.opt.disableflags = flags
        return result

    def change(self, edited: mujoco.MjModel) -> Float[np.ndarray, "sample dof"]:
        """Force that an edited model demands beyond the scene's own, (T, nv) [N·m]."""
        return self.inverse(edited) - self.demand

    @lru_cache(maxsize=64)  # noqa: B019 – lives and dies with a diagnosis
    def point(self, body: str, offset: tuple[float, float, float] | None = None) -> PointMotion:
        """Motion of a point of a body.

        Args:
            body: its name.
            offset: the point in the body's frame [m]; None for its centre of mass.
        """
        m, d = self.scene.model, self.scene.data
        i = m.body(body).id
        n, nv = len(self.t), m.nv
        x, jac, rot = np.empty((n, 3)), np.empty((n, 3, nv)), np.empty((n, 3, 3))
        for k in range(n):
            d.qpos[:] = self.q[k]
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            rot[k] = d.xmat[i].reshape(3, 3)
            x[k] = d.xipos[i] if offset is None else d.xpos[i] + rot[k] @ np.asarray(offset)
            mujoco.mj_jac(m, d, jac[k], None, x[k], i)
        return PointMotion(x, np.einsum("tij,tj->ti", jac, self.v), jac, rot)


@dataclass(frozen=True)
class PointMotion:
    """Motion of a point of a body, in the world's frame.

    Attributes:
        x: position, (T, 3) [m].
        velocity: (T, 3) [m/s].
        jacobian: of the point's position, (T, 3, nv).
        rotation: of the body's frame, (T, 3, 3).
    """

    x: Float[np.ndarray, "sample 3"]
    velocity: Float[np.ndarray, "sample 3"]
    jacobian: Float[np.ndarray, "sample 3 dof"]
    rotation: Float[np.ndarray, "sample 3 3"]

    def generalised(self, force: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "sample dof"]:
        """Generalised force of world-frame forces on the point, (T, nv), from (T, 3) [N]."""
        result: np.ndarray = np.einsum("tij,ti->tj", self.jacobian, force)
        return result
